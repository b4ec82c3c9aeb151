"""The plant over time against C MuJoCo: same torques, same external force, payload error; passive energy."""

from __future__ import annotations

import copy

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.sim import chain, cholesky
from mjx_cutting.sim.controller import Control
from mjx_cutting.sim.kernel import one_kernel
from mjx_cutting.sim.plant import answer
from mjx_cutting.sim.vectors import constant

DT = 0.002


def scalars(values):
    return [values[i] for i in range(7)]


def accelerate(robot, q, qd, torque, force, payload):
    """[7] the plant's joint accelerations through `plant.answer`."""
    given = (scalars(q), scalars(qd), scalars(torque), (force[0], force[1], force[2]), payload)
    return jnp.stack(one_kernel(lambda *x: _accelerate(robot, *x))(*given))


def _accelerate(robot, q, qd, torque, force, payload):
    inertia = chain.inertia(robot, q)
    drift = chain.drift(robot, q, qd)
    lower = cholesky.factor(inertia.mass)
    rows = [cholesky.forward(lower, [column[k] for column in inertia.linear]) for k in range(3)]
    zero = (0.0, 0.0, 0.0)
    control = Control(torque, zero, zero, 0.0, lower, rows)
    gravity = constant(robot.gravity_m_s2)
    joints, _ = answer(inertia.com_linear, drift, control, payload, gravity).accelerate(force)
    return joints


def simulate(robot, q, qd, torques, force, payload):
    def one(carry, torque):
        q, qd = carry
        qd = qd + DT * accelerate(robot, q, qd, torque, force, payload)
        return (q + DT * qd, qd), (q, qd)

    return jax.lax.scan(one, (q, qd), torques)[0]


@pytest.mark.parametrize(
    "force, payload", [((0.0, 0.0, 0.0), 0.0), ((5.0, 12.0, -8.0), 0.0), ((5.0, 12.0, 8.0), 0.4)]
)
@pytest.mark.parametrize("double", [True, False])
def test_a_thousand_steps_equal_c_mujoco(robot, force, payload, double):
    model = copy.copy(robot.model)
    model.body_mass[model.body("saw").id] += payload
    mujoco.mj_setConst(model, mujoco.MjData(model))
    # a point mass at the centre of mass leaves the inertia about it alone
    model.body_inertia[model.body("saw").id] = robot.model.body_inertia[robot.model.body("saw").id]
    data = mujoco.MjData(model)
    q0 = np.deg2rad([10.0, 45.0, -20.0, -90.0, 15.0, 45.0, 30.0])
    data.qpos[:] = q0
    mujoco.mj_forward(model, data)
    # torques of a joint-space servo that sweeps every joint, recorded here and replayed open loop below
    stiff = np.array([300.0, 300.0, 100.0, 100.0, 30.0, 30.0, 10.0])
    tcp, body, torques = model.site("tcp").id, model.body("saw").id, []
    for count in range(1000):
        mujoco.mj_forward(model, data)
        wish = q0 + 0.25 * np.sin(2.0 * np.pi * (0.4 + 0.1 * np.arange(7)) * count * DT)
        data.ctrl[:] = data.qfrc_bias + stiff * (wish - data.qpos) - 0.15 * stiff * data.qvel
        torques.append(data.ctrl.copy())
        data.qfrc_applied[:] = 0.0
        mujoco.mj_applyFT(
            model, data, np.array(force), np.zeros(3), data.site_xpos[tcp], body, data.qfrc_applied
        )
        mujoco.mj_step(model, data)
    dtype = np.float64 if double else np.float32
    with _platform.x64():
        arguments = [np.asarray(x, dtype) for x in (q0, np.zeros(7), np.stack(torques), force, payload)]
        run = jax.jit(lambda *given: simulate(robot, *given))
        q, qd = run(*arguments)
    assert np.abs(data.qpos - q0).max() > 0.1
    np.testing.assert_allclose(np.asarray(q), data.qpos, atol=1e-9 if double else 2e-3)
    np.testing.assert_allclose(np.asarray(qd), data.qvel, atol=1e-8 if double else 5e-3)


def test_the_passive_arm_keeps_its_energy(robot):
    # semi-implicit Euler: the error of the energy is of the order of dt and does not grow
    model = robot.model

    def energy(q, qd):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = q, qd
        mujoco.mj_forward(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        return data.energy.copy()

    q0 = np.deg2rad([0.0, 20.0, 10.0, -60.0, 0.0, 40.0, 0.0])
    with _platform.x64():

        def one(carry, _):
            q, qd = carry
            qd = qd + 1e-4 * accelerate(robot, q, qd, jnp.zeros(7), jnp.zeros(3), jnp.zeros(()))
            return (q + 1e-4 * qd, qd), None

        run = jax.jit(lambda q, qd: jax.lax.scan(one, (q, qd), None, length=4000)[0])
        q, qd = (np.asarray(x) for x in run(jnp.asarray(q0), jnp.zeros(7)))
    before, after = energy(q0, np.zeros(7)), energy(q, qd)
    exchanged = abs(after[0] - before[0])
    assert exchanged > 1.0
    assert abs(after.sum() - before.sum()) < 2e-3 * exchanged
