"""A small environment with a known answer, with the interface of the cutting environment.

A point x in the plane moves by x' = 0.8 x + 0.4 a + noise; the reward is -|x|^2 - 0.1 |a|^2 a step. The
observation is (x, F) with the "force" F = 5 x, to which a disturbance constant over the episode is added
where asked for. Optimal is a linear feedback (before the bound on a), whose cost is that of the discrete
Riccati equation.
"""

from types import SimpleNamespace
from typing import Any, NamedTuple

import flax.struct
import jax
import jax.numpy as jnp
import pytest

from mjx_cutting.learning.critic import CriticWrapper
from mjx_cutting.sim.env import METRICS
from mjx_cutting.sim.reward import TERMS
from mjx_cutting.sim.wrapper import TrainingWrapper

LENGTH = 16


class Point(NamedTuple):
    x: jax.Array
    disturbance: jax.Array
    steps: jax.Array
    key: jax.Array


@flax.struct.dataclass
class State:
    pipeline_state: Point
    obs: jax.Array
    reward: jax.Array
    done: jax.Array
    metrics: dict[str, jax.Array]
    info: dict[str, Any]


class PointEnv:
    observation_size = 4
    action_size = 2

    def __init__(self, disturbance: float = 0.0, length: int = LENGTH, break_at: int | None = None):
        self.disturbance = disturbance
        self.break_at = break_at
        self.config = SimpleNamespace(max_episode_steps=length, policy_step_s=0.02)

    def reset(self, key):
        key, key_x, key_d = jax.random.split(key, 3)
        x = jax.random.uniform(key_x, (2,), minval=-1.0, maxval=1.0)
        d = self.disturbance * jax.random.normal(key_d, (2,))
        zero = jnp.zeros((), jnp.float32)
        clean, corrected = self._observe(x, d)
        info = {
            "clean_obs": clean,
            "terminal_obs": corrected,
            "terminated": jnp.zeros((), bool),
            "truncated": jnp.zeros((), bool),
            "material": jnp.zeros((), jnp.int32),
            "episode_sums": {"reward": zero},
        }
        point = Point(x, d, jnp.zeros((), jnp.int32), key)
        return State(point, corrected, zero, zero, dict.fromkeys((*TERMS, *METRICS), zero), info)

    def step(self, state, action):
        x, d, steps, key = state.pipeline_state
        key, key_noise = jax.random.split(key)
        reward = -jnp.sum(x**2) - 0.1 * jnp.sum(action**2)
        x = 0.8 * x + 0.4 * action + 0.02 * jax.random.normal(key_noise, (2,))
        steps = steps + 1
        if self.break_at is not None:
            reward = jnp.where(steps == self.break_at, jnp.nan, reward)
        truncated = steps >= self.config.max_episode_steps
        clean, corrected = self._observe(x, d)
        done = truncated.astype(jnp.float32)
        info = {**state.info, "clean_obs": clean, "terminal_obs": corrected, "truncated": truncated}
        metrics = {
            **state.metrics,
            "completed": done,
            "progress_m": jnp.asarray(1.0 / self.config.max_episode_steps),
        }
        return State(Point(x, d, steps, key), corrected, reward, done, metrics, info)

    def _observe(self, x, d):
        clean = jnp.concatenate([x, 5 * x])
        return clean, clean.at[2:].add(d)


@pytest.fixture(scope="session")
def point_env():
    return PointEnv


@pytest.fixture(scope="session")
def batched():
    return lambda env: CriticWrapper(TrainingWrapper(env))
