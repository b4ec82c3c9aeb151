"""An exported policy flown in the simulation by the NumPy runtime alone, as a controller would run it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jax
import numpy as np

from mjx_cutting import _platform
from mjx_cutting.deploy.runtime import PolicyRuntime


def fly(path: Path, env: Any, policy: Any, seed: int) -> dict[str, Any]:
    """One episode closed through the runtime, and how far its actions are from JAX's on the same
    observations.

    Arguments:
        path: exported policy (npz).
        env: cutting environment.
        policy: the policy it was made from.
        seed: of the episode.

    Returns:
        `difference`: largest |runtime - JAX| over actions in [-1, 1]; `steps`; `reward`; `observation` [T,
        n]; `action` [T, m].
    """
    runtime = PolicyRuntime.load(path)
    scales = np.asarray(policy.description.observation_scales, np.float32)
    reset, step = _platform.jit(env.reset), _platform.jit(env.step)
    state = reset(jax.random.PRNGKey(seed + 2))
    seen, acted, reward = [], [], 0.0
    for _ in range(env.config.max_episode_steps):
        observation = np.asarray(state.obs)
        action = runtime(observation * scales)
        seen.append(observation)
        acted.append(action)
        state = step(state, action)
        reward += float(state.reward)
        if bool(state.done):
            break
    observations, actions = np.stack(seen), np.stack(acted)
    expected = np.asarray(policy.apply(observations))
    return {
        "difference": float(np.max(np.abs(actions - expected))),
        "steps": len(actions),
        "reward": reward,
        "observation": observations,
        "action": actions,
    }
