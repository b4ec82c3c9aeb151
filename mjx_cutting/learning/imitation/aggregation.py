"""Data-set aggregation (DAgger) on corrected observations, one round a jitted computation; cloning is a
case of it.

In a round, B episodes run side by side in the surrogate. At every step the environment gives the
observation as the target domain would (the force entries with the disturbance added) and the clean one.
The expert's action on the CLEAN observation is the label of the CORRECTED one:

    (o + d, pi*(o)),   minimise   mean |tanh mu(o + d) - pi*(o)|^2.

With probability beta, drawn at each step, the expert acts, else the learner on the corrected observation.
After the round the learner is fitted to everything gathered so far (brax's loss of behavioural cloning,
Adam), and the next round begins. The printed Algorithm 1 of the paper rolls the learner out on clean
observations and trains once at the end; that is `learner_observation="clean", update="end"`, with the same
number of updates in all.

It assumes that what the disturbance changes is visible in the observation only: the expert's label does
not know of a disturbance that also moves the tool. Reference: Ross, Gordon, Bagnell 2011, arXiv:1011.0686.
"""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass, field
from typing import Any

import flax.struct
import jax
import jax.numpy as jnp
import optax

from mjx_cutting.learning import networks as nets
from mjx_cutting.learning.imitation import buffer as buffers
from mjx_cutting.learning.imitation.schedule import AbstractSchedule
from mjx_cutting.learning.policy import Policy
from mjx_cutting.learning.settings import ImitationConfig

from brax.training import gradients  # isort: skip
from brax.training.agents.bc import losses as bc_losses, networks as bc_networks  # isort: skip


@flax.struct.dataclass
class ImitationState:
    """All that imitation goes on from; saved and restored whole.

    Arguments:
        params: the learner's parameter tree.
        optimizer: optax state.
        buffer: the aggregated data.
        owed: updates that the rounds so far call for and that have not been made.
        expert: the policy that is imitated. It and the betas are data, not constants of the program, so
            that one compilation serves every expert and both strategies.
        betas: [rounds], the expert's probability of acting.
        key: random key for everything that follows.
        iteration: rounds done.
    """

    params: Any
    optimizer: Any
    buffer: buffers.Buffer
    owed: jax.Array
    expert: Policy
    betas: jax.Array
    key: jax.Array
    iteration: jax.Array


@dataclass(frozen=True)
class Aggregation:
    """The algorithm for one environment and expert: `initialise(key)` and `iterate(state)`, both pure.

    Another imitation algorithm (GAIL, AIRL) is a class with these two methods and `policy_arrays`; the
    loop, the checkpoints and the evaluation take it as they take this one.

    Arguments:
        env: single environment (not wrapped): reset(key), step(state, action), info["clean_obs"].
        expert: the policy to imitate; its mean action is the label.
        schedule: the expert's probability of acting, by round.
        config: settings.
        episode_steps: policy steps after which an episode ends at the latest.
    """

    env: Any
    expert: Policy
    schedule: AbstractSchedule
    config: ImitationConfig
    episode_steps: int
    networks: Any = field(init=False, compare=False)
    optimizer: Any = field(init=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "networks", nets.networks_of(self.expert))
        object.__setattr__(self, "optimizer", optax.adam(self.config.learning_rate))

    @property
    def capacity(self) -> int:
        """Rows of the buffer: as configured, else room for every step of every round up to a million."""
        every = self.config.rounds * self.config.envs * self.episode_steps
        return max(self.config.capacity or min(every, 1_000_000), self.config.envs)

    def initialise(self, key: jax.Array, start: Policy | None = None) -> ImitationState:
        """Return the state before the first round.

        Arguments:
            key: random key; everything that follows depends on it alone.
            start: the learner to begin with; None: the expert.
        """
        params = nets.to_tree((start or self.expert).layers)
        zero = jnp.zeros((), jnp.int32)
        return ImitationState(
            params=params,
            optimizer=self.optimizer.init(params),
            buffer=buffers.empty(self.capacity, self.expert.observation_size, self.expert.action_size),
            owed=zero,
            expert=_bare(self.expert),
            betas=self.schedule(jnp.arange(self.config.rounds)),
            key=key,
            iteration=zero,
        )

    def iterate(self, state: ImitationState) -> tuple[ImitationState, dict[str, jax.Array]]:
        """Return the state after one round, and its metrics.

        Metrics: beta; episode_return and episode_length (means of the round's episodes); imitation_error
        (mean over the round's steps of |learner on corrected - expert on clean|^2, before the update);
        loss (mean over the updates, 0 where none was due); updates; steps (rows ever written); kept (rows
        in the buffer); finite_*.
        """
        c = self.config
        key, key_roll, key_fit = jax.random.split(state.key, 3)
        beta = state.betas[state.iteration]
        buffer, told = self._roll_out(state, beta, key_roll)
        owed = state.owed + c.epochs * (buffer.size + c.batch - 1) // c.batch
        due = jnp.asarray(True) if c.update == "round" else state.iteration + 1 >= c.rounds
        updates = jnp.where(due, owed, 0)
        params, optimizer, loss = self._fit(state, buffer, updates, key_fit)
        metrics = {
            "beta": beta,
            **told,
            "loss": loss,
            "updates": updates,
            "steps": buffer.written,
            "kept": buffer.size,
            "finite_loss": jnp.isfinite(loss),
            "finite_parameters": jnp.all(
                jnp.stack([jnp.all(jnp.isfinite(x)) for x in jax.tree_util.tree_leaves(params)])
            ),
        }
        state = ImitationState(
            params=params,
            optimizer=optimizer,
            buffer=buffer,
            owed=owed - updates,
            expert=state.expert,
            betas=state.betas,
            key=key,
            iteration=state.iteration + 1,
        )
        return state, metrics

    def policy_arrays(self, state: ImitationState) -> dict[str, Any]:
        """Return the arrays of the learner, for `Policy(...)`."""
        return {
            "mean": self.expert.mean,
            "std": self.expert.std,
            "layers": nets.to_layers(state.params),
            "value_layers": self.expert.value_layers,
            "value_mean": self.expert.value_mean,
            "value_std": self.expert.value_std,
        }

    def _roll_out(
        self, state: ImitationState, beta: jax.Array, key: jax.Array
    ) -> tuple[buffers.Buffer, dict[str, jax.Array]]:
        c = self.config
        expert, learner = state.expert, self._learner(state)
        key, key_reset = jax.random.split(key)
        env = jax.vmap(self.env.reset)(jax.random.split(key_reset, c.envs))
        step = jax.vmap(self.env.step)

        def running(carry: Any) -> jax.Array:
            t, _, active, *_ = carry
            return jnp.any(active) & (t < self.episode_steps)

        def advance(carry: Any) -> Any:
            t, env, active, buffer, sums, finite, key = carry
            key, key_who = jax.random.split(key)
            clean, corrected = env.info["clean_obs"], env.obs
            label = jnp.split(expert.logits(clean), 2, axis=-1)[0]
            seen = clean if c.learner_observation == "clean" else corrected
            expert_acts = jax.random.bernoulli(key_who, beta, (c.envs, 1))
            action = jnp.where(expert_acts, jnp.tanh(label), learner(seen))
            error = jnp.sum((learner(corrected) - jnp.tanh(label)) ** 2, axis=-1)
            buffer = buffers.append(buffer, corrected, label, active)
            env = step(env, action)
            told = jnp.stack([env.reward, error, jnp.ones_like(error)], axis=-1)
            sums = sums + jnp.where(active[:, None], told, 0.0)
            finite = {
                "finite_observation": finite["finite_observation"]
                & jnp.all(jnp.isfinite(corrected) | ~active[:, None], axis=0),
                "finite_reward": finite["finite_reward"] & jnp.all(jnp.isfinite(env.reward) | ~active),
            }
            return t + 1, env, active & (env.done < 0.5), buffer, sums, finite, key

        finite = {
            "finite_observation": jnp.ones(self.expert.observation_size, bool),
            "finite_reward": jnp.asarray(True),
        }
        start = (0, env, jnp.ones(c.envs, bool), state.buffer, jnp.zeros((c.envs, 3)), finite, key)
        _, _, _, buffer, sums, finite, _ = jax.lax.while_loop(running, advance, start)
        total = jnp.sum(sums, axis=0)
        return buffer, {
            "episode_return": total[0] / c.envs,
            "episode_length": total[2] / c.envs,
            "imitation_error": total[1] / total[2],
            **finite,
        }

    def _fit(
        self, state: ImitationState, buffer: buffers.Buffer, updates: jax.Array, key: jax.Array
    ) -> tuple[Any, Any, jax.Array]:
        make_policy = bc_networks.make_inference_fn(self.networks)
        loss = functools.partial(bc_losses.bc_loss, make_policy=make_policy)
        update = gradients.gradient_update_fn(loss, self.optimizer, pmap_axis_name=None, has_aux=True)
        normalizer = nets.normalizer_of(state.expert)

        def body(i: jax.Array, carry: Any) -> Any:
            params, optimizer, total = carry
            observation, label = buffers.sample(buffer, jax.random.fold_in(key, i), self.config.batch)
            data = {"observations": observation, "teacher_action_extras": {"loc": label}}
            (value, _), params, optimizer = update(params, normalizer, data, optimizer_state=optimizer)
            return params, optimizer, total + value

        params, optimizer, total = jax.lax.fori_loop(
            0, updates, body, (state.params, state.optimizer, jnp.zeros((), jnp.float32))
        )
        return params, optimizer, total / jnp.maximum(updates, 1)

    def _learner(self, state: ImitationState) -> Any:
        normalizer = nets.normalizer_of(state.expert)

        def act(observation: jax.Array) -> jax.Array:
            logits = self.networks.policy_network.apply(normalizer, state.params, observation)
            return self.networks.parametric_action_distribution.mode(logits)

        return act


def _bare(policy: Policy) -> Policy:
    """The policy without its value network and history, as arrays of the device."""
    bare = dataclasses.replace(policy, value_layers=None, value_mean=None, value_std=None, provenance="{}")
    return jax.tree_util.tree_map(jnp.asarray, bare)
