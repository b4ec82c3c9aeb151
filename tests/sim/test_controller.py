"""Closed loop against theory: critically damped steps, tracking without lag, deflection, held orientation."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from mjx_cutting.sim import EnvConfig, chain
from mjx_cutting.sim import robot as robots
from mjx_cutting.sim.controller import Command, control
from mjx_cutting.sim.kernel import one_kernel
from mjx_cutting.sim.plant import answer
from mjx_cutting.sim.vectors import constant

DT = 0.002
POINT = np.array([0.52, 0.15, 0.11])


@pytest.fixture(scope="module")
def loop(robot):
    """run(offset [T, 3], speed [T, 3], force [T, 3], gains [3], limit) -> TCP offsets, tilts, saturation."""
    data = mujoco.MjData(robot.model)
    data.qpos[:] = robots.WORKING_POSE_RAD
    mujoco.mj_kinematics(robot.model, data)
    axes = np.round(data.site("tcp").xmat.reshape(3, 3), 9)
    frame = tuple(constant(axes[:, k]) for k in range(3))
    start = robots.solve_pose(robot, POINT)
    config = EnvConfig()

    def one(q, qd, position, speed, force, gains, limit):
        inertia, drift = chain.inertia(robot, q), chain.drift(robot, q, qd)
        steer = control(
            inertia,
            drift.bias,
            list(qd),
            Command(position, speed, gains, frame),
            orientation_stiffness_s2=config.orientation_stiffness_s2,
            null_damping_s=config.null_damping_s,
            torque_limit_nm=robot.torque_limit_nm.tolist(),
        )
        torque = [jnp.clip(t, -limit, limit) for t in steer.torque_nm]
        gravity = constant(robot.gravity_m_s2)
        plant = answer(inertia.com_linear, drift, steer._replace(torque_nm=torque), 0.0, gravity)
        qdd, _ = plant.accelerate(force)
        return qdd, inertia.tcp_m, steer.tilt_rad

    kernel = one_kernel(one)

    @jax.jit
    def run(offset, speed, force, gains, limit, q0, qd0):
        def step(carry, each):
            q, qd = carry
            position, velocity, push = (tuple(each[i][k] for k in range(3)) for i in range(3))
            qdd, tcp, tilt = kernel(tuple(q), tuple(qd), position, velocity, push, tuple(gains), limit)
            qd = qd + DT * jnp.stack(qdd)
            return (q + DT * qd, qd), (jnp.stack(tcp) - POINT, jnp.stack(tilt), qd)

        return jax.lax.scan(step, (q0, qd0), (POINT + offset, speed, force))[1]

    def call(offset, speed, force, gains, limit=1e3, q0=start, qd0=(0.0,) * 7):
        given = (offset, speed, force, gains, limit, q0, qd0)
        return [np.asarray(x) for x in run(*(jnp.asarray(g, jnp.float32) for g in given))]

    return call


@pytest.mark.parametrize("gain", [50.0, 440.0, 3000.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_step_is_critically_damped(loop, gain, axis):
    count = 1000
    offset = np.zeros((count, 3))
    offset[:, axis] = 0.002
    moved, _, _ = loop(offset, np.zeros((count, 3)), np.zeros((count, 3)), [gain] * 3)
    time = DT * np.arange(count)
    w = np.sqrt(gain)
    analytic = 0.002 * (1.0 - (1.0 + w * time) * np.exp(-w * time))
    # the loop is sampled: the discrete response leads by about a step
    assert np.abs(moved[:, axis] - analytic).max() < 0.002 * (0.01 + 1.5 * w * DT)
    assert moved[:, axis].max() < 0.002 * 1.005
    others = np.delete(moved, axis, axis=1)
    assert np.abs(others).max() < 0.02 * 0.002


def test_a_moving_reference_is_followed_without_lag(loop):
    count, speed = 1500, 0.025
    offset = np.zeros((count, 3))
    offset[:, 1] = -speed * DT * np.arange(count)
    velocity = np.zeros((count, 3))
    velocity[:, 1] = -speed
    moved, tilt, _ = loop(offset, velocity, np.zeros((count, 3)), [50.0] * 3)
    # without the velocity fed forward the lag would be 2 v / sqrt(K_p) = 7 mm
    assert np.abs(moved[-1, 1] - offset[-1, 1]) < 2e-4
    assert np.abs(tilt).max() < 2e-3


@pytest.mark.parametrize("force", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.3, 0.5, -0.4)])
def test_static_deflection_is_that_of_the_mobility(loop, robot, force):
    gains, count = np.array([2450.0, 2080.0, 530.0]), 2500
    pushes = np.tile(force, (count, 1))
    moved, _, _ = loop(np.zeros((count, 3)), np.zeros((count, 3)), pushes, gains)
    model, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[:] = robots.solve_pose(robot, POINT)
    mujoco.mj_forward(model, data)
    mass, jacobian = np.zeros((7, 7)), np.zeros((3, 7))
    mujoco.mj_fullM(model, data, mass)
    mujoco.mj_jacSite(model, data, jacobian, np.zeros((3, 7)), model.site("tcp").id)
    mobility = jacobian @ np.linalg.inv(mass) @ jacobian.T
    expected = mobility @ np.asarray(force) / gains
    np.testing.assert_allclose(moved[-1], expected, rtol=0.02, atol=2e-6)
    # and not by the diagonal of the 6-D operational inertia, which is several times larger
    assert 1.0 / mobility[0, 0] < 3.0


def test_saturated_torques_do_not_wind_up(loop):
    # half a second of hardly any torque while the reference waits 20 mm away, then full torque again
    count = 1200
    offset = np.zeros((count, 3))
    offset[:, 0] = 0.02
    moved, _, _ = loop(offset, np.zeros((count, 3)), np.zeros((count, 3)), [440.0] * 3, limit=75.0)
    assert moved[:, 0].max() < 0.02 * 1.02
    assert moved[-1, 0] == pytest.approx(0.02, abs=2e-4)


def test_the_null_space_is_damped(loop, robot):
    # swing the elbow along the null space of the Jacobian: the tool stays, the swing dies out
    start = robots.solve_pose(robot, POINT)
    model, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[:] = start
    mujoco.mj_forward(model, data)
    jacobian = np.zeros((6, 7))
    mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], model.site("tcp").id)
    swing = np.linalg.svd(jacobian)[2][-1] * 0.2
    count = 600
    moved, _, rates = loop(
        np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3)), [2000.0] * 3, qd0=swing
    )
    assert np.linalg.norm(rates[-1]) < 0.01 * np.linalg.norm(rates[0])
    assert np.abs(moved).max() < 2e-4
