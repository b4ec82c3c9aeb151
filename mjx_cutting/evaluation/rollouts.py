"""Whole episodes of controllers in an environment, batched and jitted, with everything that happened.

All controllers face the same episodes: rollout i starts from the same random key, so it has the same sheet,
constants, errors and disturbance for each of them. A rollout ends when its episode does; the loop ends
with the longest. What is recorded lies in arrays [step, rollout, ...] with a mask of the steps that count.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from mjx_cutting import _platform
from mjx_cutting.evaluation.controllers import Controller
from mjx_cutting.learning.settings import require


@dataclass(frozen=True)
class Rollouts:
    """What happened, on the host. T is the longest episode's number of steps, N the number of rollouts.

    Arguments:
        active: [T, N] bool; whether the episode was still on at this step.
        observation: [T, N, observation] seen by the environment's user (with the disturbance), before the
            action.
        clean: [T, N, observation], the same without the disturbance; None where that is not known.
        action: [T, N, action].
        reward: [T, N], of the step that followed.
        metrics: name -> [T, N], amounts of that step as the environment gives them.
        material: [N], index of the sheet.
        period_s: policy step, s.
    """

    active: np.ndarray
    observation: np.ndarray
    clean: np.ndarray | None
    action: np.ndarray
    reward: np.ndarray
    metrics: dict[str, np.ndarray]
    material: np.ndarray
    period_s: float

    def total(self, name: str) -> np.ndarray:
        """Return the sum over each episode, [N], of a metric, or of "reward"."""
        values = self.reward if name == "reward" else self.metrics[name]
        return np.where(self.active, values, 0.0).sum(axis=0, dtype=np.float64)

    @property
    def time_s(self) -> np.ndarray:
        """Length of each episode, [N], s; where the policy does not act all the time, the metric time_s."""
        return self.total("time_s") if "time_s" in self.metrics else self.active.sum(axis=0) * self.period_s


def roll_out(
    env: Any,
    controllers: Mapping[str, Controller],
    rollouts: int = 50,
    seed: int = 0,
    steps: int | None = None,
) -> dict[str, Rollouts]:
    """Return the rollouts of each controller by name.

    Arguments:
        env: single environment (not wrapped).
        controllers: by name; controllers with policies of one size share one compilation.
        rollouts: episodes of each controller, at least 1.
        seed: decides the episodes.
        steps: policy steps after which an episode is cut; None: the environment's own limit.

    Raises: ValueError for fewer than one rollout.
    """
    require("rollouts", rollouts, rollouts >= 1, "at least 1")
    limit = env.config.max_episode_steps if steps is None else min(steps, env.config.max_episode_steps)
    run = _platform.jit(lambda controller, keys: _episodes(env, controller, keys, limit))
    keys = jax.random.split(jax.random.PRNGKey(seed), rollouts)
    period = float(env.config.policy_step_s)
    return {name: _on_host(run(_bare(c), keys), period) for name, c in controllers.items()}


def _episodes(env: Any, controller: Controller, keys: jax.Array, limit: int) -> dict[str, Any]:
    n = keys.shape[0]
    state = jax.vmap(env.reset)(keys)
    step = jax.vmap(env.step)

    def seen(state: Any) -> jax.Array:
        return jnp.where(controller.clean, state.info["clean_obs"], state.obs)

    def record(state: Any, action: jax.Array, after: Any, active: jax.Array) -> dict[str, Any]:
        return {
            "active": active,
            "observation": state.obs,
            "clean": state.info["clean_obs"],
            "action": action,
            "reward": after.reward,
            "metrics": after.metrics,
        }

    def running(carry: Any) -> jax.Array:
        t, _, _, active, _ = carry
        return (t < limit) & jnp.any(active)

    def advance(carry: Any) -> Any:
        t, state, memory, active, records = carry
        memory, action = controller.act(memory, seen(state))
        after = step(state, action)
        now = record(state, action, after, active)
        records = jax.tree_util.tree_map(lambda all_, one: all_.at[t].set(one), records, now)
        return t + 1, after, memory, active & (after.done < 0.5), records

    memory = controller.begin(seen(state))
    action = jnp.zeros((n, env.action_size), jnp.float32)
    shapes = jax.eval_shape(lambda s, a: record(s, a, step(s, a), jnp.ones(n, bool)), state, action)
    records = jax.tree_util.tree_map(lambda x: jnp.zeros((limit, *x.shape), x.dtype), shapes)
    start = (0, state, memory, jnp.ones(n, bool), records)
    length, _, _, _, records = jax.lax.while_loop(running, advance, start)
    return {**records, "length": length, "material": state.info["material"]}


def _on_host(records: dict[str, Any], period_s: float) -> Rollouts:
    length = int(records.pop("length"))
    material = np.asarray(records.pop("material"))
    cut = jax.tree_util.tree_map(lambda x: np.asarray(x[:length]), records)
    return Rollouts(**cut, material=material, period_s=period_s)


def _bare(controller: Controller) -> Controller:
    """The controller without what differs between policies and does not matter here, so that none is
    compiled twice.
    """
    policy = dataclasses.replace(
        controller.policy, value_layers=None, value_mean=None, value_std=None, provenance=json.dumps({})
    )
    return dataclasses.replace(controller, policy=policy)
