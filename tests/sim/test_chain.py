"""The serial chain against C MuJoCo and MJX, on random poses."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.sim import chain
from mjx_cutting.sim.mjx_engine import MjxEngine


def scalars(values):
    return [jnp.asarray(v) for v in values]


def full(rows):
    matrix = np.zeros((7, 7))
    for i, row in enumerate(rows):
        for j, value in enumerate(row):
            matrix[i, j] = matrix[j, i] = value
    return matrix


def reference(robot, q, qd):
    """M, h, TCP, J (6 x 7), Jc and Jc_dot qd by C MuJoCo."""
    model, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[:], data.qvel[:] = q, qd
    mujoco.mj_forward(model, data)
    mass, linear, angular, com = np.zeros((7, 7)), np.zeros((3, 7)), np.zeros((3, 7)), np.zeros((3, 7))
    mujoco.mj_fullM(model, data, mass)
    mujoco.mj_jacSite(model, data, linear, angular, model.site("tcp").id)
    mujoco.mj_jacSite(model, data, com, np.zeros((3, 7)), model.site("saw_com").id)
    rate = np.zeros((3, 7))
    mujoco.mj_jacDot(model, data, rate, np.zeros((3, 7)), data.site("saw_com").xpos, model.body("saw").id)
    return mass, data.qfrc_bias.copy(), data.site("tcp").xpos.copy(), linear, angular, com, rate @ qd


@pytest.mark.parametrize("double, tolerance", [(True, 1e-11), (False, 2e-5)])
def test_dynamics_equal_c_mujoco(robot, poses, double, tolerance):
    for q, qd in zip(*poses, strict=True):
        mass, bias, tcp, linear, angular, com, com_rate = reference(robot, q, qd)
        dtype = np.float64 if double else np.float32
        with _platform.x64():
            given_q, given_qd = scalars(q.astype(dtype)), scalars(qd.astype(dtype))
            inertia = chain.inertia(robot, given_q)
            drift = chain.drift(robot, given_q, given_qd)
        np.testing.assert_allclose(full(inertia.mass), mass, atol=tolerance * 10)
        np.testing.assert_allclose(np.asarray(drift.bias), bias, atol=tolerance * 100)
        np.testing.assert_allclose(np.asarray(inertia.tcp_m), tcp, atol=tolerance)
        np.testing.assert_allclose(np.asarray(inertia.linear).T, linear, atol=tolerance)
        np.testing.assert_allclose(np.asarray(inertia.angular).T, angular, atol=tolerance)
        np.testing.assert_allclose(np.asarray(inertia.com_linear).T, com, atol=tolerance)
        np.testing.assert_allclose(np.asarray(drift.com_m_s2), com_rate, atol=tolerance * 10)


def test_engines_agree_in_float64(robot, poses):
    q, qd = poses[0][0], poses[1][0]
    with _platform.x64():
        inertia, drift = MjxEngine(robot).evaluate(scalars(q), scalars(qd))
        own = chain.inertia(robot, scalars(q)), chain.drift(robot, scalars(q), scalars(qd))
    for ours, theirs in zip(jax.tree.leaves(own), jax.tree.leaves((inertia, drift)), strict=True):
        assert float(ours) == pytest.approx(float(theirs), abs=1e-12)


def test_moving_mass_and_height_are_those_of_the_published_figures(robot):
    # 25.61 kg of moving links; flange at 1.306 m with all joints at zero
    arm = sum(link.mass_kg for link in robot.links) - 2.5
    assert arm == pytest.approx(25.61, abs=1e-9)
    data = mujoco.MjData(robot.model)
    mujoco.mj_kinematics(robot.model, data)
    np.testing.assert_allclose(data.site("flange").xpos, [0.0, 0.0, 1.306], atol=1e-9)


def test_joint_two_holds_the_published_gravity_torque(robot):
    q = np.deg2rad([0.0, 45.0, 0.0, -90.0, 0.0, 45.0, 0.0])
    bias = chain.drift(robot, scalars(q), scalars(np.zeros(7))).bias
    assert abs(float(bias[1])) == pytest.approx(70.0, abs=1.0)
