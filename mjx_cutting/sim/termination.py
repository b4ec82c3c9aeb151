"""When an episode ends, and why.

completed: the reference has reached the end of the path. failed: the tool is too far from the path, the force
too high, the saw drawn in deeper than the force law holds, a joint at its limit of range or speed (the real
robot stops there), or a number is not finite. truncated: out of time, neither completed nor failed. Completed
and failed are `terminated`: no future reward follows; a truncated episode would have gone on.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from mjx_cutting.sim.config import EnvConfig
from mjx_cutting.sim.robot import Robot
from mjx_cutting.sim.vectors import Scalar


class Ending(NamedTuple):
    """Booleans: `completed`, `failed`, `terminated` (either of them), `truncated`, `finite`."""

    completed: Array
    failed: Array
    terminated: Array
    truncated: Array
    finite: Array


def judge(
    config: EnvConfig,
    robot: Robot,
    *,
    reference_m: Array,
    time_s: Array,
    deviation_m: Array,
    depth_m: Array,
    force_n: Array,
    q: Sequence[Scalar],
    qd: Sequence[Scalar],
    finite: Array,
) -> Ending:
    """How the episode stands after a policy step.

    Arguments: [] position of the reference along the path; [] time; [] largest path error, depth of
    engagement and force in the step; joint angles and velocities, 7 scalars each; [] whether every number is
    finite.
    """
    completed = reference_m >= config.path_m - 1e-6
    failed = (deviation_m > config.max_deviation_m) | (force_n > config.max_force_n) | ~finite
    failed |= depth_m > config.max_depth_m
    for joint in range(len(q)):
        failed |= (q[joint] < robot.lower_rad[joint]) | (q[joint] > robot.upper_rad[joint])
        failed |= jnp.abs(qd[joint]) > robot.velocity_limit_rad_s[joint]
    completed = completed & ~failed
    terminated = completed | failed
    truncated = (time_s >= config.max_episode_s - 1e-6) & ~terminated
    return Ending(completed, failed, terminated, truncated, finite)
