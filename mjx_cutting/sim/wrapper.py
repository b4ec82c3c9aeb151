"""A batch of environments for training, each with a fresh episode the moment one ends.

brax's own auto-reset replays the first state of every environment, so whatever was randomised would be drawn
once for the whole training, and it drops the last observation. Here an environment that is done starts anew
inside the same jitted step, with sheet, material, errors and disturbance drawn afresh. The state carries both
sides of the border: `obs` is the first observation of the new episode, `info["terminal_obs"]` the last one of
the old; `info["terminated"]` and `info["truncated"]` say which kind of ending it was.

Duck-typed for `brax.training` (`wrap_env_fn=wrap_for_training`): info holds steps, truncation, episode_done
and episode_metrics as its EpisodeWrapper does.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from mjx_cutting.sim.env import METRICS, CuttingEnv, EnvState
from mjx_cutting.sim.reward import TERMS

RESET_SALT = 0x5AFE


class TrainingWrapper:
    """Batched `reset` and `step` with resets inside.

    Arguments:
        env: the environment.
        episode_length: policy steps after which an episode is truncated, beside the environment's own limit;
            None: only that.
        action_repeat: policy steps for which an action is held.

    Raises:
        ValueError: an episode length or action repeat below 1.
    """

    def __init__(self, env: CuttingEnv, episode_length: int | None = None, action_repeat: int = 1):
        if action_repeat < 1 or (episode_length is not None and episode_length < 1):
            raise ValueError(
                f"episode_length is {episode_length} and action_repeat {action_repeat}; expected at least 1"
            )
        self.env = env
        self.episode_length = min(
            episode_length or env.config.max_episode_steps, env.config.max_episode_steps
        )
        self.action_repeat = action_repeat

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "env":
            raise AttributeError(name)
        return getattr(self.env, name)

    @property
    def unwrapped(self) -> CuttingEnv:
        """The single environment inside."""
        return self.env

    def reset(self, keys: Array) -> EnvState:
        """[B] fresh episodes from [B] keys."""
        state = jax.vmap(self.env.reset)(keys)
        zero = jnp.zeros_like(state.reward)
        info = dict(
            state.info,
            steps=zero,
            truncation=zero,
            episode_done=zero,
            episode_metrics=dict.fromkeys(("sum_reward", "length", *TERMS, *METRICS), zero),
        )
        return state.replace(info=info)

    def step(self, state: EnvState, action: Array) -> EnvState:
        """One policy step of all environments under actions [B, 5]; those that end start a new episode."""
        fresh_start = state.info["episode_done"] > 0.0
        own = {name: state.info[name] for name in _OWN}
        inner = {name: value for name, value in state.info.items() if name not in _OWN}
        after = state.replace(info=inner)
        reward, live = jnp.zeros_like(state.reward), jnp.ones_like(state.reward)
        metrics = {name: jnp.zeros_like(reward) for name in (*TERMS, *METRICS)}
        for _ in range(self.action_repeat):
            new = jax.vmap(self.env.step)(after, action)
            after = new if self.action_repeat == 1 else _where(live > 0.0, new, after)
            reward = reward + live * new.reward
            metrics = {name: metrics[name] + live * new.metrics[name] for name in metrics}
            live = live * (1.0 - new.done)
        steps = jnp.where(fresh_start, 0.0, own["steps"]) + self.action_repeat
        out_of_time = (steps >= self.episode_length) & ~after.info["terminated"]
        truncated = after.info["truncated"] | out_of_time
        done = (after.info["terminated"] | truncated).astype(float)
        keep = 1.0 - fresh_start.astype(float)
        totals = {
            name: own["episode_metrics"][name] * keep + value
            for name, value in {
                "sum_reward": reward,
                "length": jnp.full_like(reward, self.action_repeat),
                **metrics,
            }.items()
        }
        info = dict(
            after.info,
            truncated=truncated,
            steps=steps,
            truncation=truncated.astype(float),
            episode_done=done,
            episode_metrics=totals,
        )
        after = after.replace(reward=reward, metrics=metrics, done=done, info=info)
        return self._renew(after)

    def _renew(self, state: EnvState) -> EnvState:
        """New episodes where `done`, a handful of environments at a time; nothing is done while none is."""
        batch = state.done.shape[0]
        handful = min(batch, max(8, batch // 64))
        reset = jax.vmap(self.env.reset)

        def left(carry: tuple[EnvState, Array]) -> Array:
            return jnp.any(carry[1])

        def renew(carry: tuple[EnvState, Array]) -> tuple[EnvState, Array]:
            state, ended = carry
            (chosen,) = jnp.nonzero(ended, size=handful, fill_value=batch)  # beyond the end: dropped
            keys = state.pipeline_state.key[jnp.minimum(chosen, batch - 1)]
            fresh = reset(jax.vmap(lambda key: jax.random.fold_in(key, RESET_SALT))(keys))

            def put(old: Any, new: Any) -> Any:
                return jax.tree.map(lambda x, y: x.at[chosen].set(y, mode="drop"), old, new)

            info = {name: put(state.info[name], fresh.info[name]) for name in _RENEWED}
            state = state.replace(
                pipeline_state=put(state.pipeline_state, fresh.pipeline_state),
                obs=put(state.obs, fresh.obs),
                info={**state.info, **info},
            )
            return state, ended.at[chosen].set(False, mode="drop")

        return jax.lax.while_loop(left, renew, (state, state.done > 0.0))[0]


_OWN = ("steps", "truncation", "episode_done", "episode_metrics")
_RENEWED = ("clean_obs", "material", "episode_sums")


def wrap_for_training(
    env: CuttingEnv, episode_length: int | None = None, action_repeat: int = 1, randomization_fn: Any = None
) -> TrainingWrapper:
    """`TrainingWrapper` with the signature of brax's `wrap_env_fn`.

    Raises:
        ValueError: a `randomization_fn`; the environment randomises itself at every reset.
    """
    if randomization_fn is not None:
        raise ValueError(
            "randomization_fn is given; expected None: CuttingEnv draws its own conditions at each reset "
            "(see sim.randomize and the fields of EnvConfig)"
        )
    return TrainingWrapper(env, episode_length, action_repeat)


def _where(flag: Array, a: Any, b: Any) -> Any:
    """Leaves of `a` where `flag` [B], else of `b`."""

    def pick(x: Array, y: Array) -> Array:
        return jnp.where(flag.reshape(flag.shape + (1,) * (x.ndim - flag.ndim)), x, y)

    return jax.tree.map(pick, a, b)
