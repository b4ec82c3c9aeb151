"""The fifteen numbers the policy sees, each divided by a scale that makes it of order one.

observation = physical value / scale. Names, units and scales are exported with a policy, so that whoever runs
it can build the same vector. Pose and velocity are those of the last control cycle (one physics step old),
as a controller has them; the force is the mean of the last samples, base axes.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

NAMES = (
    "speed_along_path", "path_error_x", "path_error_y", "path_error_z", "velocity_x", "velocity_y",
    "velocity_z", "force_x", "force_y", "force_z", "feed_adjustment", "depth", "log_stiffness_x",
    "log_stiffness_y", "log_stiffness_z",
)  # fmt: skip
UNITS = ("m/s", *("m",) * 3, *("m/s",) * 3, *("N",) * 3, "1", "m", *("ln(s^-2)",) * 3)
SCALES = (0.0125, *(0.01,) * 3, *(0.0125,) * 3, *(10.0,) * 3, 1.0, 0.001, *(6.0,) * 3)
"""Nominal feed; 10 mm of path error; 10 N; 1 mm of depth; ln K_p is 3.9 to 8.0."""
SIZE = len(NAMES)
FORCE = slice(7, 10)


def observe(
    speed_along_m_s: Array,
    path_error_m: Array,
    velocity_m_s: Array,
    force_n: Array,
    feed_adjustment: Array,
    depth_m: Array,
    stiffness_s2: Array,
) -> Array:
    """[15] the scaled observation.

    Arguments: [] speed along the path; [3] reference minus actual position; [3] TCP velocity; [3] measured
    force; [] feed adjustment and [] depth set-points; [3] position gains, s^-2.
    """
    parts = [
        jnp.reshape(speed_along_m_s, (1,)),
        path_error_m,
        velocity_m_s,
        force_n,
        jnp.reshape(feed_adjustment, (1,)),
        jnp.reshape(depth_m, (1,)),
        jnp.log(stiffness_s2),
    ]
    return jnp.concatenate(parts) / jnp.asarray(SCALES, float)
