"""`chain.Inertia` and `chain.Drift` from the stages of MuJoCo MJX: the reference engine.

Only the stages that this task needs are called (kinematics, com_pos, crb, com_vel, rne), once each, and their
mass matrix and Jacobian serve controller and plant alike; mjx.step would add constraints, geoms and sensors.
Under plain jit on a CPU these stages run into XLA's fusion trap: use `_platform.jit`, or engine "fused".
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import jax.numpy as jnp
from jax import Array
from mujoco import mjx

from mjx_cutting.sim.chain import Drift, Inertia
from mjx_cutting.sim.robot import JOINTS, Robot
from mjx_cutting.sim.vectors import Scalar, Vector


class MjxEngine:
    """Dynamics of the robot by MJX."""

    def __init__(self, robot: Robot):
        self._model = mjx.put_model(robot.model)
        self._tcp = robot.model.site("tcp").id
        self._com = robot.model.site("saw_com").id
        self._saw = robot.model.body("saw").id

    def evaluate(self, q: list[Scalar], qd: list[Scalar]) -> tuple[Inertia, Drift]:
        """Both at joint angles and velocities, 7 scalars each; for one environment (vmap it)."""
        model = self._model
        velocity = jnp.stack([jnp.asarray(x) for x in qd])
        data = mjx.make_data(model).replace(qpos=jnp.stack([jnp.asarray(x) for x in q]), qvel=velocity)
        for stage in (mjx.kinematics, mjx.com_pos, mjx.crb, mjx.com_vel, mjx.rne):
            data = stage(model, data)
        full = mjx.full_m(model, data)
        tcp, com = data.site_xpos[self._tcp], data.site_xpos[self._com]
        linear, angular = mjx.jac(model, data, tcp, self._saw)
        com_linear, _ = mjx.jac(model, data, com, self._saw)
        frame = data.site_xmat[self._tcp]
        inertia = Inertia(
            mass=[[full[i, j] for j in range(i + 1)] for i in range(JOINTS)],
            tcp_m=_vector(tcp),
            tool_frame=(_vector(frame[:, 0]), _vector(frame[:, 1]), _vector(frame[:, 2])),
            linear=[_vector(row) for row in linear],
            angular=[_vector(row) for row in angular],
            com_linear=[_vector(row) for row in com_linear],
        )
        bias = [data.qfrc_bias[i] for i in range(JOINTS)]
        return inertia, Drift(bias, _vector(self._com_bias(data, velocity, com, com_linear, angular)))

    def _com_bias(self, data: Any, velocity: Array, com: Array, linear: Array, angular: Array) -> Array:
        """Acceleration of the saw's centre of mass at zero joint acceleration, from the rates of the dofs."""
        rate = (data.cdof_dot * velocity[:, None]).sum(axis=0)
        root = data.subtree_com[self._model.body_rootid[self._saw]]
        spin, speed = angular.T @ velocity, linear.T @ velocity
        return rate[3:] + jnp.cross(rate[:3], com - root) + jnp.cross(spin, speed)


@lru_cache(maxsize=1)
def shared(robot: Robot) -> MjxEngine:
    """The engine of `robot`, made once."""
    return MjxEngine(robot)


def _vector(array: Array) -> Vector:
    return (array[0], array[1], array[2])
