"""Rigid-body dynamics of a serial chain, one scalar at a time.

Mass matrix M(q) by composite rigid bodies and bias h(q, qd) = C qd + g by recursive Newton-Euler, both in
link coordinates about the link's origin (Featherstone, Rigid Body Dynamics Algorithms (2008), ch. 5 and
6). A link turns about its own z axis after a constant turn that is a permutation of axes here, so a change
of frame costs six operations; link inertias about the link's origin are constants. The pose of the tool
and its Jacobians are in the base frame. All values are tuples of scalars (see `vectors`). The plant is M
qdd + h = tau + J^T F.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from mjx_cutting.sim.robot import Link, Robot
from mjx_cutting.sim.vectors import (
    IDENTITY,
    ZERO,
    Frame,
    Scalar,
    Vector,
    add,
    combine,
    constant,
    cross,
    dot,
    minus,
    mul,
    plus,
    scale,
    sub,
    total,
)

Symmetric = tuple[Scalar, Scalar, Scalar, Scalar, Scalar, Scalar]
"""xx, yy, zz, xy, xz, yz."""


class Turn(NamedTuple):
    """Sine and cosine of a joint angle."""

    sine: Scalar
    cosine: Scalar


class Inertia(NamedTuple):
    """What depends on the pose alone.

    Fields:
        mass: lower triangle of M, rows of lengths 1 to 7, kg m^2.
        tcp_m, tool_frame: tool centre point and tool frame in the base frame.
        linear, angular: columns of the TCP Jacobian, 7 vectors each.
        com_linear: columns of the Jacobian of the tool's centre of mass, 7 vectors.
    """

    mass: list[list[Scalar]]
    tcp_m: Vector
    tool_frame: Frame
    linear: list[Vector]
    angular: list[Vector]
    com_linear: list[Vector]


class Drift(NamedTuple):
    """What goes on at zero joint acceleration.

    Fields: `bias` h, 7 torques, N m, gravity included; `com_m_s2` acceleration of the tool's centre of mass,
    gravity NOT included.
    """

    bias: list[Scalar]
    com_m_s2: Vector


def inertia(robot: Robot, q: list[Scalar]) -> Inertia:
    """`Inertia` at joint angles `q`, 7 scalars, rad."""
    turns = _turns(q)
    frames, origins = _place(robot, turns)
    last, origin = frames[-1], origins[-1]
    tcp = plus(origin, combine(constant(robot.tcp_m), last))
    com = plus(origin, combine(constant(robot.tool_com_m), last))
    axes = [frame[2] for frame in frames]
    return Inertia(
        mass=_composite(robot, turns),
        tcp_m=tcp,
        tool_frame=tuple(combine(constant(robot.tool_rotation[:, k]), last) for k in range(3)),  # type: ignore[arg-type]
        linear=[cross(z, minus(tcp, o)) for z, o in zip(axes, origins, strict=True)],
        angular=axes,
        com_linear=[cross(z, minus(com, o)) for z, o in zip(axes, origins, strict=True)],
    )


def drift(robot: Robot, q: list[Scalar], qd: list[Scalar]) -> Drift:
    """`Drift` at joint angles `q` (rad) and velocities `qd` (rad/s), 7 scalars each."""
    turns = _turns(q)
    bias, com_rate = _newton_euler(robot, turns, qd)
    last = _place(robot, turns)[0][-1]
    return Drift(bias, plus(combine(com_rate, last), constant(robot.gravity_m_s2)))


def _turns(q: list[Scalar]) -> list[Turn]:
    return [Turn(jnp.sin(angle), jnp.cos(angle)) for angle in q]


def _place(robot: Robot, turns: list[Turn]) -> tuple[list[Frame], list[Vector]]:
    """Frame and origin of each link in the base frame."""
    frame, origin = IDENTITY, ZERO
    frames, origins = [], []
    for link, turn in zip(robot.links, turns, strict=True):
        origin = plus(origin, combine(constant(link.position_m), frame))
        x, y, z = (combine(constant(link.rotation[:, k]), frame) for k in range(3))
        frame = (
            plus(scale(turn.cosine, x), scale(turn.sine, y)),
            minus(scale(turn.cosine, y), scale(turn.sine, x)),
            z,
        )
        frames.append(frame)
        origins.append(origin)
    return frames, origins


def _composite(robot: Robot, turns: list[Turn]) -> list[list[Scalar]]:
    """Lower triangle of M: what turning joint i gives the links beyond it, felt at joint j."""
    count = len(robot.links)
    rows: list[list[Scalar]] = [[] for _ in range(count)]
    mass, moment = 0.0, ZERO
    about: Symmetric = (0.0,) * 6
    for i in reversed(range(count)):
        link = robot.links[i]
        mass += link.mass_kg
        moment = plus(moment, constant(link.mass_kg * link.com_m))
        about = _sum(about, _about_origin(link))
        force: Vector = (mul(-1.0, moment[1]), moment[0], 0.0)
        torque: Vector = (about[4], about[5], about[2])
        row = [torque[2]]
        for j in reversed(range(1, i + 1)):
            here, shift = robot.links[j], constant(robot.links[j].position_m)
            force = _to_parent(here, turns[j], force)
            torque = plus(_to_parent(here, turns[j], torque), cross(shift, force))
            row.append(torque[2])
        rows[i] = row[::-1]
        if i:
            shift = constant(link.position_m)
            moment = _to_parent(link, turns[i], moment)
            about = _shifted(_turned(link, turns[i], about), mass, moment, shift)
            moment = plus(moment, scale(mass, shift))
    return rows


def _newton_euler(robot: Robot, turns: list[Turn], qd: list[Scalar]) -> tuple[list[Scalar], Vector]:
    """Bias torques, and the acceleration (minus g) of the tool's centre of mass in the last link's frame."""
    spin, spin_rate, rate = ZERO, ZERO, scale(-1.0, constant(robot.gravity_m_s2))
    forces, moments = [], []
    for link, turn, speed in zip(robot.links, turns, qd, strict=True):
        rate = _to_child(link, turn, _carried(rate, spin, spin_rate, constant(link.position_m)))
        spin, spin_rate = _to_child(link, turn, spin), _to_child(link, turn, spin_rate)
        spin_rate = (
            add(spin_rate[0], mul(spin[1], speed)),
            sub(spin_rate[1], mul(spin[0], speed)),
            spin_rate[2],
        )
        spin = (spin[0], spin[1], add(spin[2], speed))
        first, about = constant(link.mass_kg * link.com_m), _about_origin(link)
        forces.append(plus(scale(link.mass_kg, rate), _carried(ZERO, spin, spin_rate, first)))
        moments.append(
            plus(
                plus(_apply(about, spin_rate), cross(spin, _apply(about, spin))),
                cross(first, rate),
            )
        )
    tool = _carried(rate, spin, spin_rate, constant(robot.tool_com_m))
    bias: list[Scalar] = []
    force, moment = ZERO, ZERO
    for i in reversed(range(len(robot.links))):
        force, moment = plus(force, forces[i]), plus(moment, moments[i])
        bias.append(moment[2])
        if i:
            link = robot.links[i]
            force = _to_parent(link, turns[i], force)
            moment = plus(_to_parent(link, turns[i], moment), cross(constant(link.position_m), force))
    return bias[::-1], tool


def _carried(rate: Vector, spin: Vector, spin_rate: Vector, arm: Vector) -> Vector:
    """Acceleration of a point at `arm` on a body that turns: a + alpha x r + w x (w x r)."""
    return plus(rate, plus(cross(spin_rate, arm), cross(spin, cross(spin, arm))))


def _to_parent(link: Link, turn: Turn, a: Vector) -> Vector:
    """Coordinates in the parent's frame of a vector given in the link's."""
    x = sub(mul(turn.cosine, a[0]), mul(turn.sine, a[1]))
    y = add(mul(turn.sine, a[0]), mul(turn.cosine, a[1]))
    return _rows(link.rotation, (x, y, a[2]))


def _to_child(link: Link, turn: Turn, a: Vector) -> Vector:
    """Coordinates in the link's frame of a vector given in its parent's."""
    x, y, z = _rows(link.rotation.T, a)
    return (
        add(mul(turn.cosine, x), mul(turn.sine, y)),
        sub(mul(turn.cosine, y), mul(turn.sine, x)),
        z,
    )


def _rows(matrix: np.ndarray, a: Vector) -> Vector:
    """A constant matrix [3, 3] times a vector."""
    return (dot(constant(matrix[0]), a), dot(constant(matrix[1]), a), dot(constant(matrix[2]), a))


def _about_origin(link: Link) -> Symmetric:
    """Constant inertia of one link about its own origin, link frame."""
    c = link.com_m
    full = link.inertia_kg_m2 + link.mass_kg * (c @ c * np.eye(3) - np.outer(c, c))
    xx, yy, zz = constant(np.diag(full))
    xy, xz, yz = constant([full[0, 1], full[0, 2], full[1, 2]])
    return (xx, yy, zz, xy, xz, yz)


def _turned(link: Link, turn: Turn, inertia: Symmetric) -> Symmetric:
    """Coordinates in the parent's axes of an inertia given in the link's."""
    xx, yy, zz, xy, xz, yz = inertia
    s, c = turn
    lean = mul(mul(s, c), sub(xx, yy))
    cross_term = mul(2.0, mul(mul(s, c), xy))
    gain = mul(mul(s, s), sub(yy, xx))
    turned = (
        sub(add(xx, gain), cross_term),
        add(sub(yy, gain), cross_term),
        zz,
        add(lean, mul(sub(mul(c, c), mul(s, s)), xy)),
        sub(mul(c, xz), mul(s, yz)),
        add(mul(s, xz), mul(c, yz)),
    )
    full = [
        [turned[0], turned[3], turned[4]],
        [turned[3], turned[1], turned[5]],
        [turned[4], turned[5], turned[2]],
    ]
    r = link.rotation

    def entry(a: int, b: int) -> Scalar:
        terms = []
        for i in range(3):
            for j in range(3):
                weight = float(r[a, i] * r[b, j])
                if abs(weight) > 1e-12:
                    terms.append(mul(weight, full[i][j]))
        return total(terms)

    return (entry(0, 0), entry(1, 1), entry(2, 2), entry(0, 1), entry(0, 2), entry(1, 2))


def _sum(a: Symmetric, b: Symmetric) -> Symmetric:
    return tuple(add(x, y) for x, y in zip(a, b, strict=True))  # type: ignore[return-value]


def _apply(s: Symmetric, a: Vector) -> Vector:
    xx, yy, zz, xy, xz, yz = s
    return (dot((xx, xy, xz), a), dot((xy, yy, yz), a), dot((xz, yz, zz), a))


def _shifted(inertia: Symmetric, mass: float, moment: Vector, shift: Vector) -> Symmetric:
    """Inertia about a point `shift` before the old one, where the first moment about the old one is `moment`.

    I + 2 d.u 1 - d u^T - u d^T with u = moment + m d / 2.
    """
    u = plus(moment, scale(0.5 * mass, shift))
    x, y, z = mul(shift[0], u[0]), mul(shift[1], u[1]), mul(shift[2], u[2])
    xx, yy, zz, xy, xz, yz = inertia
    return (
        add(xx, mul(2.0, add(y, z))), add(yy, mul(2.0, add(x, z))), add(zz, mul(2.0, add(x, y))),
        sub(xy, add(mul(shift[0], u[1]), mul(shift[1], u[0]))),
        sub(xz, add(mul(shift[0], u[2]), mul(shift[2], u[0]))),
        sub(yz, add(mul(shift[1], u[2]), mul(shift[2], u[1]))),
    )  # fmt: skip
