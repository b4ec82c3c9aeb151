"""Training a policy by PPO in a cutting environment: the expert, and the PPO strategies of adaptation.

Fine-tuning and re-training are the same training in the surrogate, with and without a policy to start from.
Several seeds run side by side in one computation (`vmap` over the state), sharing compile time and device.
"""

from __future__ import annotations

import dataclasses
import functools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from mjx_cutting import _platform
from mjx_cutting.learning.critic import CRITIC, POLICY, CriticWrapper
from mjx_cutting.learning.distributed import Alone
from mjx_cutting.learning.environment import describe
from mjx_cutting.learning.loop import Training, run_training
from mjx_cutting.learning.policy import FILE, Policy
from mjx_cutting.learning.ppo import PPO
from mjx_cutting.learning.settings import PPOConfig
from mjx_cutting.sim.wrapper import TrainingWrapper


def train_policy(
    env: Any,
    config: PPOConfig,
    run: Path,
    *,
    seed: int = 0,
    seeds: int = 1,
    start: Policy | None = None,
    strategy: str = "expert",
    settings: Any = None,
    may_differ: tuple[str, ...] = (),
    resume: Path | None = None,
    checkpoint_every_s: float = 60.0,
    quiet: bool = False,
    tensorboard: bool = False,
    shards: Alone | None = None,
) -> tuple[Policy, ...]:
    """Train by PPO and return one policy a seed; each is also a file in the run folder.

    Arguments:
        env: a cutting environment (single, not wrapped).
        config: settings of PPO; with `start`, the network's sizes are those of `start`.
        run: run folder.
        seed: of the first of the seeds; the others follow it.
        seeds: independent trainings side by side, at least 1.
        start: policy to go on from (fine-tuning); its normaliser stays as it is.
        strategy: told in the policy's provenance and the progress bar.
        settings: what a resumed run must share (a dataclass or mapping); default: `config`.
        may_differ: dotted names of `settings` that it need not share.
        resume, checkpoint_every_s, quiet, tensorboard: as in `loop.run_training`.
        shards: the processes and devices that share the environments; None: this process alone.

    Raises: as `loop.run_training`; ValueError when `start` does not fit the environment.
    """
    description, shards = describe(env), shards or Alone()
    batched = CriticWrapper(TrainingWrapper(env))
    if start is not None:
        _check_fits(start, batched)
        config = sized_like(config, start)
    ppo = PPO(batched, config, start is not None, shards.count, shards.axis)
    keys = jnp.stack([jax.random.PRNGKey(seed + i) for i in range(seeds)])
    initialise: Callable[..., Any] = functools.partial(ppo.initialise, start=start)
    iterate: Callable[..., Any] = ppo.iterate
    if seeds > 1:
        initialise, iterate = jax.vmap(initialise), jax.vmap(iterate)

    def policies(state: Any) -> dict[str, Policy]:
        made = {}
        for i in range(seeds):
            one = jax.tree_util.tree_map(lambda x, i=i: x[i], state) if seeds > 1 else state
            provenance = {
                "strategy": strategy,
                "seed": seed + i,
                "iterations": int(one.iteration),
                "steps": int(one.iteration) * config.steps_per_iteration,
            }
            made[policy_file(i)] = Policy(
                **ppo.policy_arrays(one),
                activation=config.activation,
                description=description,
                provenance=json.dumps(provenance),
            )
        return made

    training = Training(
        title=strategy,
        initialise=lambda: _platform.jit_for_few_calls(shards.on_each(initialise))(
            keys if seeds > 1 else keys[0]
        ),
        iterate=shards.on_all(iterate),
        iterations=config.iterations,
        steps_per_iteration=config.steps_per_iteration * seeds,
        policies=policies,
        config=config if settings is None else settings,
        may_differ=may_differ,
        names={"finite_observation": description.observation_names},
        shards=shards,
    )
    state = run_training(training, run, resume, checkpoint_every_s, quiet, tensorboard)
    return tuple(policies(shards.first(shards.collect(state))).values())


def initial_policy(env: Any, config: PPOConfig, seed: int = 0) -> Policy:
    """Return the policy that training with this seed starts from, before any step: the yardstick of
    training.
    """
    ppo = PPO(CriticWrapper(TrainingWrapper(env)), config)
    return Policy(
        **ppo.policy_arrays(ppo.initial_parameters(jax.random.split(jax.random.PRNGKey(seed), 3)[1])),
        activation=config.activation,
        description=describe(env),
        provenance=json.dumps({"strategy": "untrained", "seed": seed}),
    )


def policy_file(index: int) -> str:
    """Return the file name of the policy of one of several seeds; the first is the run's policy."""
    return FILE if index == 0 else f"policy_seed_{index}.npz"


def sized_like(config: PPOConfig, policy: Policy) -> PPOConfig:
    """Return the settings with the network of a policy."""
    value = (
        policy.hidden
        if policy.value_layers is None
        else tuple(w.shape[-1] for w, _ in policy.value_layers[:-1])
    )
    return dataclasses.replace(
        config, hidden=policy.hidden, value_hidden=tuple(int(w) for w in value), activation=policy.activation
    )


def _check_fits(policy: Policy, env: CriticWrapper) -> None:
    (observed,), (judged,) = (env.observation_size[name] for name in (POLICY, CRITIC))
    got, expected = (policy.observation_size, policy.action_size), (observed, env.action_size)
    if got != expected:
        raise ValueError(
            f"got a policy with {got[0]} observations and {got[1]} actions; expected {expected[0]} and "
            f"{expected[1]} as in the environment; give a policy trained in this environment"
        )
    if policy.value_layers is None:
        return
    sees = int(policy.value_layers[0][0].shape[0])
    if sees != judged:
        # Beside the observation it sees progress, time, and one entry a sheet.
        sheets, here = sees - observed - 2, judged - observed - 2
        raise ValueError(
            f"got a policy whose value network was trained with {sheets} sheets for a simulation with "
            f"{here}; expected as many entries in materials, the value network having an input for each; to "
            f"go on with fewer sheets repeat them, as in materials={('aluminium',) * sheets}"
        )
