"""The robot: C MuJoCo at 1 kHz, and the operational-space controller that drives it.

    tau* = J^T Lambda (K_p e + 2 sqrt(K_p) de) + bias + damping of the elbow in the null space of J,
    Lambda = (J M^-1 J^T)^-1

(Khatib, IEEE J. Robotics and Automation 3 (1987) 43-53), with the orientation held. The controller's M is
that of the links; the plant has rotor inertia, viscous damping and dry friction besides, and its torques
follow with a lag. The wrist sensor is MuJoCo's, between transducer and saw, so it feels the saw's weight and
inertia. Base axes: x transverse to the cut, y against the feed, z up.
"""

from __future__ import annotations

from importlib import resources

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv

Array = NDArray[np.float64]
STEP_S = 1e-3
POSE_RAD = np.deg2rad([0.0, 45.0, 0.0, -90.0, 0.0, 45.0, 0.0])
TORQUE_LAG_S = 0.002
ORIENTATION_S2 = 1000.0
ELBOW_DAMPING_S = 10.0


class Arm:
    """The robot with its saw.

    Arguments: `tip_m` [3] where the saw's lowest point starts; `friction` factor on the joints' dry and
    viscous friction, 0 for none.

    Fields after every step: `tip_m`, `velocity_m_s` [3]; `wrist_n` [3] load on the saw side of the sensor
    less its reading at rest; `saturated` whether a torque was clipped.

    Raises:
        ValueError: the start cannot be reached.
    """

    def __init__(self, tip_m: tuple[float, float, float], friction: float = 1.0):
        text = (resources.files("mjx_cutting.deploy.virtual_cell") / "arm.xml").read_text()
        self.model = mujoco.MjModel.from_xml_string(text)
        self.model.dof_frictionloss[:] *= friction
        self.model.dof_damping[:] *= friction
        if friction == 0.0:  # dry friction is what the constraint solver is there for
            self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self.data = mujoco.MjData(self.model)
        self._tip, self._saw = self.model.site("tip").id, self.model.body("saw").id
        self._mount = self.model.site("mount").id
        self._jacobian, self._mass = np.zeros((6, 7)), np.zeros((7, 7))
        self._linear, self._angular = self._jacobian[:3], self._jacobian[3:]
        self._limit = self.model.actuator_ctrlrange[:, 1].copy()
        self._follow = 1.0 - np.exp(-STEP_S / TORQUE_LAG_S)
        self._angular_gain = np.full(3, ORIENTATION_S2)
        self.data.qpos[:] = POSE_RAD
        mujoco.mj_forward(self.model, self.data)
        self._held = self.data.site_xmat[self._tip].reshape(3, 3).copy()
        self._start = self._reach(np.asarray(tip_m, float))
        self.saturated = False
        self.reset()

    def reset(self) -> None:
        """Back to the start, at rest; the sensor is zeroed there."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = self._start
        mujoco.mj_forward(self.model, self.data)
        self.data.ctrl[:] = self.data.qfrc_bias
        mujoco.mj_forward(self.model, self.data)
        self._zero = self._wrist()
        self._read()

    def step(self, goal_m: Array, goal_m_s: Array, gain_s2: Array, force_n: Array, lever_m: Array) -> None:
        """One millisecond under the controller and a force.

        Arguments: `goal_m`, `goal_m_s` [3] of the tip; `gain_s2` [3] position gains K_p; `force_n` [3] on
        the saw; `lever_m` [3] from the tip to where it acts.
        """
        data = self.data
        mujoco.mj_step1(self.model, data)
        mujoco.mj_jacSite(self.model, data, self._linear, self._angular, self._tip)
        mujoco.mj_fullM(self.model, data, self._mass)
        links = self._mass.copy()
        links.flat[::8] -= self.model.dof_armature
        speed = self._jacobian @ data.qvel
        tip = data.site_xpos[self._tip]
        wish = np.empty(6)
        wish[:3] = gain_s2 * (goal_m - tip) + 2.0 * np.sqrt(gain_s2) * (goal_m_s - speed[:3])
        wish[3:] = self._angular_gain * self._tilt() - 2.0 * np.sqrt(self._angular_gain) * speed[3:]
        wish += ELBOW_DAMPING_S * speed
        spread = dposv(links, self._jacobian.T)[1]
        wrench = dposv(self._jacobian @ spread, wish)[1]
        torque = self._jacobian.T @ wrench - ELBOW_DAMPING_S * (links @ data.qvel) + data.qfrc_bias
        given = np.minimum(np.maximum(torque, -self._limit), self._limit)
        self.saturated = bool(np.any(given != torque))
        data.ctrl[:] += self._follow * (given - data.ctrl)
        arm = tip + lever_m - data.xipos[self._saw]
        push = data.xfrc_applied[self._saw]
        push[:3] = force_n
        push[3] = arm[1] * force_n[2] - arm[2] * force_n[1]
        push[4] = arm[2] * force_n[0] - arm[0] * force_n[2]
        push[5] = arm[0] * force_n[1] - arm[1] * force_n[0]
        mujoco.mj_step2(self.model, data)
        self.wrist_n = self._zero - self._wrist()
        self._read()

    @property
    def sound(self) -> bool:
        """Whether the state is finite and every joint inside its range."""
        q, limits = self.data.qpos, self.model.jnt_range
        return bool(np.all((q > limits[:, 0]) & (q < limits[:, 1])))

    def _read(self) -> None:
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_jacSite(self.model, self.data, self._linear, self._angular, self._tip)
        self.tip_m = self.data.site_xpos[self._tip].copy()
        self.velocity_m_s = self._linear @ self.data.qvel

    def _wrist(self) -> Array:
        """What the transducer holds the saw with, base axes: the controller turns the sensor's axes back."""
        return self.data.site_xmat[self._mount].reshape(3, 3) @ self.data.sensordata[:3]

    def _tilt(self) -> Array:
        """[3] rotation vector from the tip's frame to the one held, exact to third order."""
        twist = self._held @ self.data.site_xmat[self._tip].reshape(3, 3).T
        return 0.5 * np.array(
            [twist[2, 1] - twist[1, 2], twist[0, 2] - twist[2, 0], twist[1, 0] - twist[0, 1]]
        )

    def _reach(self, tip_m: Array) -> Array:
        """[7] joint angles with the tip at a point and the frame held, by damped least squares."""
        data = mujoco.MjData(self.model)
        data.qpos[:] = POSE_RAD
        for _ in range(300):
            mujoco.mj_kinematics(self.model, data)
            mujoco.mj_comPos(self.model, data)
            mujoco.mj_jacSite(self.model, data, self._linear, self._angular, self._tip)
            twist = self._held @ data.site_xmat[self._tip].reshape(3, 3).T
            turn = 0.5 * np.array(
                [twist[2, 1] - twist[1, 2], twist[0, 2] - twist[2, 0], twist[1, 0] - twist[0, 1]]
            )
            miss = np.concatenate([tip_m - data.site_xpos[self._tip], turn])
            if np.abs(miss).max() < 1e-10:
                return data.qpos.copy()
            inner = np.linalg.solve(self._jacobian @ self._jacobian.T + 1e-8 * np.eye(6), miss)
            data.qpos[:] += np.clip(self._jacobian.T @ inner, -0.2, 0.2)
        raise ValueError(
            f"got a start at {tip_m.tolist()} m that the arm cannot reach; expected one in reach"
        )
