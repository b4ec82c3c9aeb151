"""Operational-space impedance control with saturation.

    tau = clip(J^T Lambda (u + d J qd) - d M qd + h)
    u_linear  = K_p (p_ref - p) + 2 sqrt(K_p) (v_ref - v)
    u_angular = K_o e_o - 2 sqrt(K_o) w
    Lambda    = (J M^-1 J^T)^-1, 6 x 6

Khatib, IEEE J. Robotics and Automation 3 (1987) 43-53. Damping is critical for the commanded gains; the
reference velocity is fed forward (without it the tool lags by 2 v / sqrt(K_p)); the orientation of the
working pose is held. -d M qd + J^T Lambda d J qd is the damping -d M qd of the whole arm projected into the
null space of J, since Jbar^T M qd = Lambda J qd. Under a load F the tool yields by K_p^-1 (J_v M^-1 J_v^T) F
whatever K_o is. There is no integral term, so torque saturation cannot wind up. J_dot qd is left out: at the
joint speeds of a cut it is below 1e-3 m/s^2.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from mjx_cutting.sim import cholesky
from mjx_cutting.sim.chain import Inertia
from mjx_cutting.sim.vectors import (
    Frame,
    Scalar,
    Vector,
    constant,
    cross,
    dot,
    minus,
    mul,
    plus,
    scale,
    total,
)


class Command(NamedTuple):
    """What the controller is asked to do, base frame.

    Fields: `position_m`, `velocity_m_s` of the TCP; `stiffness_s2` position gains K_p per axis, s^-2;
    `frame` orientation to hold (constant columns).
    """

    position_m: Vector
    velocity_m_s: Vector
    stiffness_s2: Vector
    frame: Frame


class Control(NamedTuple):
    """Joint torques and what was computed on the way.

    Fields: `torque_nm` 7 torques after saturation; `velocity_m_s` of the TCP; `tilt_rad` rotation vector from
    the tool frame to the one asked for; `saturated` 1 where a torque was clipped, else 0; `lower` factor of
    M, and `rows` L^-1 J_v^T for the three linear axes, 7 scalars each.
    """

    torque_nm: list[Scalar]
    velocity_m_s: Vector
    tilt_rad: Vector
    saturated: Scalar
    lower: cholesky.Lower
    rows: list[list[Scalar]]


def control(
    inertia: Inertia,
    bias: list[Scalar],
    qd: list[Scalar],
    command: Command,
    *,
    orientation_stiffness_s2: float,
    null_damping_s: float,
    torque_limit_nm: list[float],
) -> Control:
    """Torques for one physics step.

    Arguments:
        inertia, bias: of the controller's own model (without payload error); bias 7 torques, N m.
        qd: joint velocities, 7 scalars, rad/s.
        command: set-points.
        orientation_stiffness_s2: K_o, s^-2.
        null_damping_s: d, s^-1.
        torque_limit_nm: 7 limits, N m.
    """
    velocity, spin = weigh(inertia.linear, qd), weigh(inertia.angular, qd)
    tilt = _tilt(inertia.tool_frame, command.frame)
    error = minus(command.position_m, inertia.tcp_m)
    lag = minus(command.velocity_m_s, velocity)
    linear = [
        mul(k, e) + mul(2.0 * jnp.sqrt(k), v)
        for k, e, v in zip(command.stiffness_s2, error, lag, strict=True)
    ]
    angular = minus(scale(orientation_stiffness_s2, tilt), scale(2.0 * orientation_stiffness_s2**0.5, spin))
    wish = [u + null_damping_s * v for u, v in zip((*linear, *angular), (*velocity, *spin), strict=True)]
    lower = cholesky.factor(inertia.mass)
    rows = [
        cholesky.forward(lower, [column[k] for column in columns])
        for columns in (inertia.linear, inertia.angular)
        for k in range(3)
    ]
    mobility = [[dot(rows[i], rows[j]) for j in range(i + 1)] for i in range(6)]
    wrench = cholesky.solve(cholesky.factor(mobility), wish)
    momentum = multiply(inertia.mass, qd)
    torque: list[Scalar] = []
    excess: Scalar = 0.0
    for i, limit in enumerate(torque_limit_nm):
        lever = dot(inertia.linear[i], wrench[:3]) + dot(inertia.angular[i], wrench[3:])
        asked = lever - null_damping_s * momentum[i] + bias[i]
        given = jnp.clip(asked, -limit, limit)
        torque.append(given)
        excess = excess + jnp.abs(asked - given)
    return Control(torque, velocity, tilt, jnp.where(excess > 0.0, 1.0, 0.0), lower, rows[:3])


def multiply(matrix: cholesky.Lower, vector: list[Scalar]) -> list[Scalar]:
    """A b for a symmetric matrix given by its lower triangle."""
    count = len(matrix)
    return [total(mul(matrix[max(i, j)][min(i, j)], vector[j]) for j in range(count)) for i in range(count)]


def weigh(columns: list[Vector], weights: list[Scalar]) -> Vector:
    """Sum of columns, each times its weight."""
    value = scale(weights[0], columns[0])
    for column, weight in zip(columns[1:], weights[1:], strict=True):
        value = plus(value, scale(weight, column))
    return value


def _tilt(frame: Frame, goal: Frame) -> Vector:
    """Rotation vector from `frame` to `goal`, exact to third order in the angle."""
    value = cross(frame[0], constant(goal[0]))
    for now, wish in zip(frame[1:], goal[1:], strict=True):
        value = plus(value, cross(now, constant(wish)))
    return scale(0.5, value)
