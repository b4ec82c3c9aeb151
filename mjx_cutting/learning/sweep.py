"""Trainings of several settings and seeds side by side on one device, in one computation (`vmap`).

Settings that are factors in the computation may differ between the trainings (`FACTORS`); those that decide
sizes and loops (environments, steps, networks) are shared. Compiling is done once for all of them.
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from mjx_cutting import _platform
from mjx_cutting.learning.critic import CriticWrapper
from mjx_cutting.learning.ppo import PPO
from mjx_cutting.learning.settings import PPOConfig
from mjx_cutting.sim.wrapper import TrainingWrapper

FACTORS = (
    "learning_rate",
    "discount",
    "gae_lambda",
    "clip",
    "entropy_cost",
    "value_cost",
    "reward_scaling",
    "max_grad_norm",
    "initial_std",
    "noise_scale",
    "noise_scale_final",
)
LAST = 0.1
"""Share of the training, at its end, over which the episode reward is averaged."""


def train_all(
    env: Any, config: PPOConfig, proposals: Sequence[Mapping[str, float]], seeds: int = 1, seed: int = 0
) -> np.ndarray:
    """Train every proposal with every seed and return the episode reward at the end, [proposals, seeds].

    Arguments:
        env: a cutting environment (single, not wrapped).
        config: settings that the proposals change.
        proposals: settings by name, the same names in each, out of `FACTORS`.
        seeds: trainings of each proposal.
        seed: of the first of them; the others follow it.

    The reward is a mean over the last tenth of the training; NaN where no episode ended there, or where the
    training met a number that is not finite.

    Raises: ValueError for a setting that is none of `FACTORS` or out of its range, or proposals of different
        names.
    """
    names = tuple(proposals[0]) if proposals else ()
    for proposal in proposals:
        unknown = sorted(set(proposal) - set(FACTORS))
        if unknown or tuple(proposal) != names:
            raise ValueError(
                f"got a proposal of {', '.join(proposal)}; expected the same settings in each, out of "
                f"{', '.join(FACTORS)}; run others one after another"
            )
        changed: dict[str, Any] = dict(proposal)
        dataclasses.replace(config, **changed)  # checks the range
    batched = CriticWrapper(TrainingWrapper(env))

    def learner(values: Mapping[str, jax.Array]) -> PPO:
        return PPO(batched, _with(config, values))

    def start(values: Mapping[str, jax.Array], key: jax.Array) -> Any:
        return learner(values).initialise(key)

    def advance(values: Mapping[str, jax.Array], state: Any) -> Any:
        return learner(values).iterate(state)

    keys = jnp.stack([jax.random.PRNGKey(seed + i) for i in range(seeds)])
    values = {
        name: jnp.repeat(jnp.asarray([p[name] for p in proposals], jnp.float32), seeds) for name in names
    }
    state = _platform.jit_for_few_calls(jax.vmap(start))(values, jnp.tile(keys, (len(proposals), 1)))
    iterate = _platform.jit(jax.vmap(advance))
    total, ended = np.zeros(len(proposals) * seeds), np.zeros(len(proposals) * seeds)
    fine = np.ones(len(proposals) * seeds, bool)
    first = config.iterations - max(1, round(LAST * config.iterations))
    for i in range(config.iterations):
        state, told = iterate(values, state)
        flags = [np.asarray(told[f"finite_{name}"]) for name in ("reward", "loss", "parameters")]
        fine = fine & np.all(flags, axis=0)
        if i >= first:
            count = np.asarray(told["episodes"], float)
            total = total + np.where(count > 0, count * np.asarray(told["episode_return"]), 0.0)
            ended = ended + count
    with np.errstate(invalid="ignore", divide="ignore"):
        reward: np.ndarray = np.where(fine & (ended > 0), total / ended, np.nan)
    return reward.reshape(len(proposals), seeds)


def _with(config: PPOConfig, values: Mapping[str, Any]) -> PPOConfig:
    """The settings with some that are being traced, which cannot be checked."""
    changed = copy.copy(config)
    for name, value in values.items():
        object.__setattr__(changed, name, value)
    return changed
