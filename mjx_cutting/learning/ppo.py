"""One iteration of proximal policy optimisation, composed of brax.training's parts.

    unroll the policy -> update the normaliser -> epochs of minibatch steps on brax's clipped loss

brax's train function cannot resume, replays the first state of each environment and drops terminal
observations, so this module composes `acting.generate_unroll`, `losses.compute_ppo_loss`, `gradients` and
`running_statistics` into one pure function `(state) -> (state, metrics)` that the caller jits, vmaps over
seeds and saves whole.

An episode that ends by time is not an end of the task. brax's loss leaves such a step out; here the value
of the observation in which the episode stopped is added to the last reward,

    r' = r + gamma V(o_terminal),

and the step counts as an end, which makes its advantage exact (Pardo et al. 2018, arXiv:1712.00378). It
breaks when the environment does not hand over that observation in `info["terminal_obs"]`.

Reference: Schulman et al. 2017, arXiv:1707.06347.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import flax.struct
import jax
import jax.numpy as jnp
import optax

from mjx_cutting.learning import networks as nets
from mjx_cutting.learning.critic import CRITIC, POLICY
from mjx_cutting.learning.policy import Policy
from mjx_cutting.learning.settings import PPOConfig

from brax.training import acting, distribution, gradients  # isort: skip
from brax.training.agents.ppo import losses, networks as ppo_networks  # isort: skip


@flax.struct.dataclass
class Learner:
    """The networks' parameters (brax's PPONetworkParams) and the normaliser of their observations."""

    params: Any
    normalizer: Any


@flax.struct.dataclass
class PPOState:
    """All that training goes on from; saved and restored whole.

    Arguments:
        params: brax's PPONetworkParams (policy and value).
        optimizer: optax state.
        normalizer: running statistics of the observations.
        env: batched environment state, [envs, ...].
        episode_return, episode_length: of the episodes under way, [envs].
        key: random key for everything that follows.
        iteration: iterations done.
    """

    params: Any
    optimizer: Any
    normalizer: Any
    env: Any
    episode_return: jax.Array
    episode_length: jax.Array
    key: jax.Array
    iteration: jax.Array


@dataclass(frozen=True)
class PPO:
    """The algorithm for one environment: `initialise(key)` and `iterate(state)`, both pure.

    Arguments:
        env: batched environment (`sim.wrapper`): reset(keys [envs]), step(state, action [envs, action]),
            with a new episode begun at every end and info "truncated", "terminal_obs".
        config: settings.
        freeze_normalizer: keep the statistics training starts with (for policies trained further).
        shards: parts into which the environments are split, each in a call of its own; divides envs.
        axis: name of the mapped axis over the shards, along which gradients are averaged; None: one shard.
    """

    env: Any
    config: PPOConfig
    freeze_normalizer: bool = False
    shards: int = 1
    axis: str | None = None
    networks: Any = field(init=False, compare=False)
    optimizer: Any = field(init=False, compare=False)

    def __post_init__(self) -> None:
        c = self.config
        if c.envs % (self.shards * c.minibatches):
            raise ValueError(
                f"got envs={c.envs} in {self.shards} shards and minibatches={c.minibatches}; expected a "
                f"multiple of {self.shards * c.minibatches}; set --ppo.envs or --ppo.minibatches accordingly"
            )
        networks = nets.make_networks(
            self.env.observation_size, self.env.action_size, c.hidden, c.value_hidden, c.activation
        )
        rate: Any = c.learning_rate
        if c.learning_rate_final is not None:
            updates = c.iterations * c.epochs * c.minibatches
            rate = optax.linear_schedule(c.learning_rate, c.learning_rate_final, updates)
        optimizer = optax.chain(optax.clip_by_global_norm(c.max_grad_norm), optax.adam(rate, eps=1e-5))
        object.__setattr__(self, "networks", networks)
        object.__setattr__(self, "optimizer", optimizer)

    def initialise(self, key: jax.Array, start: Policy | None = None) -> PPOState:
        """Return the state before the first iteration.

        Arguments:
            key: random key; everything that follows depends on it alone.
            start: a policy of the same sizes to go on from; its normaliser is taken over as well.
        """
        key, key_learner, key_env = jax.random.split(key, 3)
        learner = self.initial_parameters(key_learner, start)
        envs = self.config.envs // self.shards
        zeros = jnp.zeros(envs, jnp.float32)
        return PPOState(
            params=learner.params,
            optimizer=self.optimizer.init(learner.params),
            normalizer=learner.normalizer,
            env=self.env.reset(jax.random.split(self._own(key_env), envs)),
            episode_return=zeros,
            episode_length=zeros,
            key=key,
            iteration=jnp.zeros((), jnp.int32),
        )

    def initial_parameters(self, key: jax.Array, start: Policy | None = None) -> Learner:
        """Return the networks' parameters and the normaliser before the first iteration, as in
        `initialise`.
        """
        key_policy, key_value = jax.random.split(key)
        policy = nets.modest(
            self.networks.policy_network.init(key_policy), self.env.action_size, self.config.initial_std
        )
        value = self.networks.value_network.init(key_value)
        normalizer = nets.initial_normalizer(self.env.observation_size)
        if start is not None:
            policy = nets.to_tree(start.layers)
            mean, std = {POLICY: start.mean}, {POLICY: start.std}
            if start.value_layers is not None:
                value = nets.to_tree(start.value_layers)
                mean[CRITIC], std[CRITIC] = start.value_mean, start.value_std
            normalizer = normalizer.replace(
                mean={**normalizer.mean, **jax.tree_util.tree_map(jnp.asarray, mean)},
                std={**normalizer.std, **jax.tree_util.tree_map(jnp.asarray, std)},
            )
        return Learner(losses.PPONetworkParams(policy=policy, value=value), normalizer)

    def iterate(self, state: PPOState) -> tuple[PPOState, dict[str, jax.Array]]:
        """Return the state after one iteration, and its metrics.

        Metrics: episode_return and episode_length (means over the `episodes` that ended in this iteration,
        NaN where none did), reward (mean of a step), brax's losses, kl_mean, and `finite_*`: whether
        observations, rewards, losses and parameters are all finite.
        """
        c = self.config
        key, key_unroll, key_learn = jax.random.split(state.key, 3)
        networks = self._networks_with_noise(state.iteration)
        act = ppo_networks.make_inference_fn(networks)(
            (state.normalizer, state.params.policy, state.params.value)
        )
        env, data = acting.generate_unroll(
            self.env,
            state.env,
            act,
            self._own(key_unroll),
            c.unroll_length,
            extra_fields=("truncated", "terminal_obs", "episode_metrics"),
        )
        episodes = _episodes(state, data, self._sum)
        normalizer = state.normalizer
        if not self.freeze_normalizer:
            normalizer = nets.update_normalizer(normalizer, data.observation, self.axis)
        data = self._bootstrap(normalizer, state.params.value, data)
        data = jax.tree_util.tree_map(lambda x: jnp.swapaxes(x, 0, 1), data)  # [envs, time, ...]
        params, optimizer, learned = self._learn(networks, state, normalizer, data, self._own(key_learn))
        metrics = {
            **{name: self._mean(jnp.mean(value)) for name, value in learned.items()},
            **episodes.metrics,
            "reward": self._mean(jnp.mean(data.reward)),
            "finite_observation": self._all(jnp.all(jnp.isfinite(data.observation[POLICY]), axis=(0, 1))),
            "finite_reward": self._all(_finite(data.reward)),
            "finite_loss": self._all(_finite(learned["total_loss"])),
            "finite_parameters": self._all(_finite(params)),
        }
        state = PPOState(
            params=params,
            optimizer=optimizer,
            normalizer=normalizer,
            env=env,
            episode_return=episodes.running_return,
            episode_length=episodes.running_length,
            key=key,
            iteration=state.iteration + 1,
        )
        return state, metrics

    def policy_arrays(self, state: PPOState | Learner) -> dict[str, Any]:
        """Return the arrays of the state's policy, for `Policy(...)`."""
        return {
            "mean": jax.device_get(state.normalizer.mean[POLICY]),
            "std": jax.device_get(state.normalizer.std[POLICY]),
            "layers": nets.to_layers(state.params.policy),
            "value_layers": nets.to_layers(state.params.value),
            "value_mean": jax.device_get(state.normalizer.mean[CRITIC]),
            "value_std": jax.device_get(state.normalizer.std[CRITIC]),
        }

    def _own(self, key: jax.Array) -> jax.Array:
        """The key of this shard: what is drawn with it differs between shards."""
        return key if self.axis is None else jax.random.fold_in(key, jax.lax.axis_index(self.axis))

    def _sum(self, x: jax.Array) -> jax.Array:
        return x if self.axis is None else jax.lax.psum(x, self.axis)

    def _mean(self, x: jax.Array) -> jax.Array:
        return x if self.axis is None else jax.lax.pmean(x, self.axis)

    def _all(self, flag: jax.Array) -> jax.Array:
        return flag if self.axis is None else jax.lax.pmin(flag.astype(jnp.int32), self.axis) > 0

    def _bootstrap(self, normalizer: Any, value_params: Any, data: Any) -> Any:
        extras = data.extras["state_extras"]
        value = self.networks.value_network.apply(normalizer, value_params, extras["terminal_obs"])
        truncated = extras["truncated"].astype(jnp.float32)
        # compute_ppo_loss scales the reward, so the value (of scaled rewards) is divided by the scale first.
        bonus = truncated * self.config.discount * value / self.config.reward_scaling
        extras = {"truncation": jnp.zeros_like(truncated)}
        return data._replace(
            reward=data.reward + jnp.where(truncated > 0, bonus, 0.0),
            extras={"policy_extras": data.extras["policy_extras"], "state_extras": extras},
        )

    def _learn(
        self, networks: Any, state: PPOState, normalizer: Any, data: Any, key: jax.Array
    ) -> tuple[Any, Any, dict[str, jax.Array]]:
        c = self.config
        update = gradients.gradient_update_fn(
            self._loss(networks), self.optimizer, pmap_axis_name=self.axis, has_aux=True
        )

        def minibatch(carry: Any, rows: jax.Array) -> Any:
            params, optimizer, key = carry
            key, key_loss = jax.random.split(key)
            batch = jax.tree_util.tree_map(lambda x: x[rows], data)
            (_, metrics), params, optimizer = update(
                params, normalizer, batch, key_loss, optimizer_state=optimizer
            )
            return (params, optimizer, key), metrics

        def epoch(carry: Any, key: jax.Array) -> Any:
            rows = jax.random.permutation(key, c.envs // self.shards).reshape(c.minibatches, -1)
            return jax.lax.scan(minibatch, carry, rows)

        key, key_epochs = jax.random.split(key)
        (params, optimizer, _), metrics = jax.lax.scan(
            epoch, (state.params, state.optimizer, key), jax.random.split(key_epochs, c.epochs)
        )
        return params, optimizer, metrics

    def _networks_with_noise(self, iteration: jax.Array) -> Any:
        c = self.config
        second_half = jnp.clip(2.0 * iteration / c.iterations - 1.0, 0.0, 1.0)
        scale = c.noise_scale + second_half * (c.noise_scale_final - c.noise_scale)
        actions = distribution.NormalTanhDistribution(self.env.action_size, var_scale=scale)
        return self.networks.replace(parametric_action_distribution=actions)

    def _loss(self, networks: Any) -> Callable[..., Any]:
        c = self.config
        return functools.partial(
            losses.compute_ppo_loss,
            ppo_network=networks,
            entropy_cost=c.entropy_cost,
            discounting=c.discount,
            reward_scaling=c.reward_scaling,
            gae_lambda=c.gae_lambda,
            clipping_epsilon=c.clip,
            vf_coefficient=c.value_cost,
        )


@flax.struct.dataclass
class _Episodes:
    running_return: jax.Array
    running_length: jax.Array
    metrics: dict[str, jax.Array]


def _episodes(state: PPOState, data: Any, over_shards: Callable[[jax.Array], jax.Array]) -> _Episodes:
    """Follow the returns of episodes over an unroll, data [time, envs]; `over_shards` sums over shards."""

    def step(carry: Any, now: Any) -> Any:
        running_return, running_length, total, length, count = carry
        reward, done = now
        running_return, running_length = running_return + reward, running_length + 1
        carry = (
            running_return * (1 - done),
            running_length * (1 - done),
            total + jnp.sum(done * running_return),
            length + jnp.sum(done * running_length),
            count + jnp.sum(done),
        )
        return carry, None

    zero = jnp.zeros((), jnp.float32)
    start = (state.episode_return, state.episode_length, zero, zero, zero)
    (running_return, running_length, total, length, count), _ = jax.lax.scan(
        step, start, (data.reward, 1.0 - data.discount)
    )
    total, length, count = over_shards(total), over_shards(length), over_shards(count)
    ended = jnp.where(count > 0, count, jnp.nan)
    metrics = {"episode_return": total / ended, "episode_length": length / ended, "episodes": count}
    sums = data.extras["state_extras"]["episode_metrics"]
    for name in ("completed", "failed", "mrv_mm3"):
        if name in sums:
            metrics[name] = over_shards(jnp.sum(sums[name] * (1.0 - data.discount))) / ended
    return _Episodes(running_return, running_length, metrics)


def _finite(tree: Any) -> jax.Array:
    return jnp.all(jnp.stack([jnp.all(jnp.isfinite(x)) for x in jax.tree_util.tree_leaves(tree)]))
