"""The paper's reward, one policy step at a time:

    r = Q_mrv MRV - Q_cut dt - (e Q_d e) dt - (f Q_f f) dt

MRV is the volume removed in the step, mm^3; e the path error, mm; f the load on the tool, N (the process
force, with the disturbance where that acts on the robot; without sensor noise and bias, which no action could
change), as its mean over the step; e squared is averaged over the physics steps. A failure costs once.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
from jax import Array

from mjx_cutting.sim.config import EnvConfig
from mjx_cutting.sim.vectors import Scalar

TERMS = ("reward_mrv", "reward_time", "reward_path", "reward_force", "reward_failure")


def terms(
    config: EnvConfig,
    volume_mm3: Scalar,
    error_squared_mm2: Sequence[Scalar],
    force_squared_n2: Sequence[Scalar],
    failed: Array,
) -> dict[str, Array]:
    """The terms of `TERMS` whose sum is the reward.

    Arguments: removed volume; mean square path error [3] and square of the mean load [3]; whether it failed.
    """
    dt = config.policy_step_s
    path = sum(q * e for q, e in zip(config.reward_path_per_mm2_s, error_squared_mm2, strict=True))
    force = sum(q * f for q, f in zip(config.reward_force_per_n2_s, force_squared_n2, strict=True))
    return {
        "reward_mrv": jnp.asarray(config.reward_mrv_per_mm3 * volume_mm3),
        "reward_time": jnp.full(jnp.shape(volume_mm3), -config.reward_time_per_s * dt, float),
        "reward_path": jnp.asarray(-path * dt),
        "reward_force": jnp.asarray(-force * dt),
        "reward_failure": jnp.where(failed, config.failure_reward, 0.0).astype(float),
    }
