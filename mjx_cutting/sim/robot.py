"""The robot: the MJCF, and its numbers as a serial chain.

A serial chain is a list of links, each turning about its own local z axis; bodies welded to a link (sensor,
saw) are lumped into it. The numbers are read from the compiled MuJoCo model, so the MJCF stays the only
source. Breaks for robots with slide joints, branches, or joint axes other than local z: `load` refuses them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

ASSET = "iiwa14.xml"
JOINTS = 7
VELOCITY_LIMIT_RAD_S = tuple(np.deg2rad([85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0]).tolist())
"""Joint velocity limits of the LBR iiwa 14 R820 (KUKA data sheet)."""
WORKING_POSE_RAD = tuple(np.deg2rad([0.0, 45.0, 0.0, -90.0, 0.0, 45.0, 0.0]).tolist())
"""Flange straight down over the bench; the inverse kinematics starts here."""


@dataclass(frozen=True)
class Link:
    """One moving link.

    Fields: `position_m` [3] and `rotation` [3, 3] of its frame in the parent link at joint angle 0;
    `mass_kg`; `com_m` [3] and `inertia_kg_m2` [3, 3] about the centre of mass, both in the link frame.
    """

    position_m: np.ndarray
    rotation: np.ndarray
    mass_kg: float
    com_m: np.ndarray
    inertia_kg_m2: np.ndarray


@dataclass(frozen=True)
class Robot:
    """The compiled model and the chain read from it.

    Fields: `model` the MuJoCo model; `links` the seven links; `tcp_m`, `tool_com_m` [3] tool centre point and
    centre of mass of what the sensor carries, in the frame of the last link; `tool_mass_kg` mass that the
    sensor carries; `tool_rotation` [3, 3] tool frame in the last link; `lower_rad`, `upper_rad` [7] joint
    range; `torque_limit_nm`, `velocity_limit_rad_s` [7]; `gravity_m_s2` [3].
    """

    model: Any
    links: tuple[Link, ...]
    tcp_m: np.ndarray
    tool_com_m: np.ndarray
    tool_mass_kg: float
    tool_rotation: np.ndarray
    lower_rad: np.ndarray
    upper_rad: np.ndarray
    torque_limit_nm: np.ndarray
    velocity_limit_rad_s: np.ndarray
    gravity_m_s2: np.ndarray


def asset_path() -> Path:
    """Path of the MJCF that ships with the package."""
    return Path(str(resources.files("mjx_cutting.sim") / "assets" / ASSET))


@lru_cache(maxsize=1)
def load() -> Robot:
    """The robot of the package; compiled once per process.

    Raises:
        ValueError: the MJCF is not a serial chain of hinges about local z.
    """
    model = mujoco.MjModel.from_xml_path(str(asset_path()))
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    _check(model)
    bodies = [int(model.jnt_bodyid[j]) for j in range(JOINTS)]
    links = []
    parent_rotation, parent_position = np.eye(3), np.zeros(3)
    for joint, body in enumerate(bodies):
        rotation, position = data.xmat[body].reshape(3, 3), data.xpos[body]
        welded = [body, *_welded(model, body)]
        mass, com, inertia = _lump(model, data, welded, rotation, position)
        links.append(
            Link(
                _clean(parent_rotation.T @ (position - parent_position)),
                _clean(parent_rotation.T @ rotation),
                mass,
                _clean(com),
                _clean(inertia),
            )
        )
        parent_rotation, parent_position = rotation, position
        if joint and model.body_parentid[body] != bodies[joint - 1]:
            raise ValueError(f"body {model.body(body).name} does not hang on the link before it")
    saw = model.body("saw").id
    mass, com, _ = _lump(model, data, [saw], parent_rotation, parent_position)
    return Robot(
        model=model,
        links=tuple(links),
        tcp_m=_clean(parent_rotation.T @ (data.site("tcp").xpos - parent_position)),
        tool_com_m=_clean(com),
        tool_mass_kg=mass,
        tool_rotation=_clean(parent_rotation.T @ data.site("tcp").xmat.reshape(3, 3)),
        lower_rad=model.jnt_range[:, 0].copy(),
        upper_rad=model.jnt_range[:, 1].copy(),
        torque_limit_nm=model.actuator_ctrlrange[:, 1].copy(),
        velocity_limit_rad_s=np.asarray(VELOCITY_LIMIT_RAD_S),
        gravity_m_s2=model.opt.gravity.copy(),
    )


def solve_pose(robot: Robot, tcp_m: np.ndarray, start_rad: Any = WORKING_POSE_RAD) -> np.ndarray:
    """[7] joint angles that bring the TCP to `tcp_m` [3] with the flange straight down and the saw across.

    Damped least squares from `start_rad` on the host, to 1e-10 m.

    Raises:
        ValueError: the point cannot be reached inside the joint limits.
    """
    model, data = robot.model, mujoco.MjData(robot.model)
    site = model.site("tcp").id
    data.qpos[:] = WORKING_POSE_RAD
    mujoco.mj_kinematics(model, data)
    goal = data.site_xmat[site].reshape(3, 3).copy()
    data.qpos[:] = start_rad
    jacobian = np.zeros((6, JOINTS))
    for _ in range(200):
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], site)
        now = data.site_xmat[site].reshape(3, 3)
        error = np.concatenate(
            [tcp_m - data.site_xpos[site], 0.5 * sum(np.cross(now[:, k], goal[:, k]) for k in range(3))]
        )
        if np.abs(error).max() < 1e-10:
            break
        damped = jacobian @ jacobian.T + 1e-8 * np.eye(6)
        data.qpos[:] += np.clip(jacobian.T @ np.linalg.solve(damped, error), -0.2, 0.2)
    angles = data.qpos.copy()
    inside = np.all(angles > robot.lower_rad) and np.all(angles < robot.upper_rad)
    if np.abs(error).max() > 1e-8 or not inside:
        raise ValueError(
            f"the robot cannot hold the saw at {np.round(tcp_m, 4).tolist()} m in its base frame; "
            "expected a point within reach, about 0.45 to 0.7 m in front of the base and at bench height"
        )
    return angles


def _check(model: Any) -> None:
    hinges = np.all(model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE)
    if model.njnt != JOINTS or not hinges or not np.allclose(model.jnt_axis, [0.0, 0.0, 1.0]):
        raise ValueError(f"{ASSET} must be a chain of {JOINTS} hinges about local z")


def _welded(model: Any, body: int) -> list[int]:
    """Bodies that hang on `body` without a joint of their own."""
    found: list[int] = []
    for child in range(body + 1, model.nbody):
        if model.body_jntnum[child] == 0 and model.body_parentid[child] in (body, *found):
            found.append(child)
    return found


def _lump(
    model: Any, data: Any, bodies: list[int], rotation: np.ndarray, position: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass and inertia about it of several bodies as one, in the frame given."""
    mass = float(sum(model.body_mass[b] for b in bodies))
    com = sum(model.body_mass[b] * data.xipos[b] for b in bodies) / mass
    inertia = np.zeros((3, 3))
    for b in bodies:
        axes = data.ximat[b].reshape(3, 3)
        arm = data.xipos[b] - com
        inertia += axes @ np.diag(model.body_inertia[b]) @ axes.T
        inertia += model.body_mass[b] * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return mass, rotation.T @ (com - position), rotation.T @ inertia @ rotation


def _clean(values: np.ndarray) -> np.ndarray:
    """The same numbers with rounding dust removed, so that structural zeros are exact."""
    return np.where(np.abs(values) < 1e-12, 0.0, np.round(values, 15))
