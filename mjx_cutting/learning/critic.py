"""What the value network sees beside the observation: how far along the path, for how long, and which sheet.

The policy sees what the real controller will see, which does not tell where on the path the tool is. A
value that cannot see it either cannot credit a fast step with the time it saves, hundreds of steps later.
So the critic, which is needed in training only, is given what the simulation knows (Pinto et al. 2018,
arXiv:1710.06542):

    o_critic = (o, share of the path done, time in units of 10 s, one of each sheet)

The wrapper hands out observations as brax's networks take them, {"state": o, "critic": o_critic}. It reads
the sums over the episode that the training wrapper keeps, and breaks when these lose progress_m or length.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

POLICY = "state"
CRITIC = "critic"


class CriticWrapper:
    """The batched training environment with the critic's observation beside the policy's.

    Arguments:
        env: `sim.wrapper.TrainingWrapper`, batched.
    """

    def __init__(self, env: Any):
        self.env = env
        self._sheets = len(getattr(env.config, "materials", ("one",)))
        self._path_m = float(getattr(env.config, "path_m", 1.0))
        self._period_s = float(env.config.policy_step_s)

    @property
    def observation_size(self) -> dict[str, tuple[int, ...]]:
        """Sizes of the two observations."""
        size = self.env.observation_size
        return {POLICY: (size,), CRITIC: (size + 2 + self._sheets,)}

    @property
    def action_size(self) -> int:
        """Entries of an action."""
        return self.env.action_size

    def reset(self, keys: jax.Array) -> Any:
        """[envs] fresh episodes from [envs] keys."""
        return self._with_critic(self.env.reset(keys))

    def step(self, state: Any, action: jax.Array) -> Any:
        """One step of all environments; info["terminal_obs"] too has both observations."""
        return self._with_critic(self.env.step(state.replace(obs=state.obs[POLICY]), action))

    def _with_critic(self, state: Any) -> Any:
        # Where an episode has just ended, the sums are still those of the old one and obs is of the new one.
        sums, material = state.info["episode_metrics"], state.info["material"]
        under_way = 1.0 - state.info["episode_done"]
        progress, steps = sums["progress_m"] / self._path_m, sums["length"]
        last = self._observe(state.info["terminal_obs"], progress, steps, material)
        now = self._observe(state.obs, progress * under_way, steps * under_way, material)
        return state.replace(obs=now, info={**state.info, "terminal_obs": last})

    def _observe(
        self, obs: jax.Array, progress: jax.Array, steps: jax.Array, material: jax.Array
    ) -> dict[str, jax.Array]:
        extra = jnp.stack([progress, steps * self._period_s / 10.0], axis=-1)
        sheet = jax.nn.one_hot(material, self._sheets)
        return {POLICY: obs, CRITIC: jnp.concatenate([obs, extra, sheet], axis=-1)}
