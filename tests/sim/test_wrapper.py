"""The training wrapper: fresh draws at every end, both kinds of ending, the last observation, brax."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.sim import CuttingEnv, EnvConfig, TrainingWrapper, wrap_for_training
from mjx_cutting.sim.env import METRICS
from mjx_cutting.sim.reward import TERMS

BATCH = 8


@pytest.fixture(scope="module")
def wrapped():
    """Episodes of six steps, four of them allowed by the wrapper."""
    wrapper = TrainingWrapper(CuttingEnv(EnvConfig()), episode_length=4)
    return wrapper, jax.jit(wrapper.reset), jax.jit(wrapper.step)


@pytest.fixture(scope="module")
def played(wrapped):
    """States of ten steps, the reset first."""
    _, reset, step = wrapped
    states = [reset(jax.random.split(jax.random.key(0), BATCH))]
    for _ in range(10):
        states.append(step(states[-1], jnp.ones((BATCH, 5))))
    return states


def test_every_episode_end_draws_afresh(played):
    materials = [np.asarray(s.pipeline_state.episode.material.K_te_n_m) for s in played]
    spindle = [np.asarray(s.pipeline_state.episode.spindle_angle_rad) for s in played]
    for before, after, now, then in zip(materials, materials[1:], spindle, spindle[1:], strict=False):
        changed = (before != after) & (now != then)
        assert changed.all() or not changed.any()
    first, second, third = materials[0], materials[4], materials[8]
    assert (first != second).all() and (second != third).all() and (first != third).all()


def test_steps_and_truncation(played):
    steps = np.stack([np.asarray(s.info["steps"]) for s in played])
    np.testing.assert_array_equal(steps[:, 0], [0, 1, 2, 3, 4, 1, 2, 3, 4, 1, 2])
    done = np.stack([np.asarray(s.done) for s in played])
    np.testing.assert_array_equal(done[:, 0], [0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0])
    for state in (played[4], played[8]):
        assert np.asarray(state.info["truncated"]).all() and not np.asarray(state.info["terminated"]).any()
        np.testing.assert_array_equal(np.asarray(state.info["truncation"]), 1.0)
    assert not np.asarray(played[5].info["truncated"]).any()


def test_both_sides_of_the_border_are_there(played):
    # the old episode's last observation holds set-points that have moved, the new one's first does not
    ended = played[4]
    assert (np.asarray(ended.info["terminal_obs"])[:, 11] > 0.07).all()
    np.testing.assert_allclose(np.asarray(ended.obs)[:, 11], 0.0, atol=1e-7)
    np.testing.assert_array_equal(np.asarray(ended.pipeline_state.time_s), 0.0)
    going = played[3]
    np.testing.assert_array_equal(np.asarray(going.obs), np.asarray(going.info["terminal_obs"]))


def test_episode_metrics_are_sums_over_one_episode(played):
    rewards = np.stack([np.asarray(s.reward) for s in played])
    for last in (4, 8):
        metrics = played[last].info["episode_metrics"]
        np.testing.assert_allclose(
            np.asarray(metrics["sum_reward"]), rewards[last - 3 : last + 1].sum(axis=0), rtol=1e-5
        )
        np.testing.assert_array_equal(np.asarray(metrics["length"]), 4.0)
        assert set(metrics) == {"sum_reward", "length", *TERMS, *METRICS}


def test_a_broken_environment_starts_anew_alone(wrapped):
    wrapper, reset, step = wrapped
    state = step(reset(jax.random.split(jax.random.key(1), BATCH)), jnp.zeros((BATCH, 5)))
    broken = np.asarray(state.pipeline_state.q).copy()
    broken[5] = np.nan
    state = state.replace(pipeline_state=state.pipeline_state._replace(q=jnp.asarray(broken)))
    after = step(state, jnp.zeros((BATCH, 5)))
    expected = np.zeros(BATCH)
    expected[5] = 1.0
    np.testing.assert_array_equal(np.asarray(after.done), expected)
    np.testing.assert_array_equal(np.asarray(after.metrics["nan"]), expected)
    assert float(after.reward[5]) == wrapper.config.failure_reward
    again = step(after, jnp.zeros((BATCH, 5)))
    assert all(
        np.isfinite(np.asarray(leaf)).all()
        for leaf in jax.tree.leaves((again.obs, again.reward, again.pipeline_state.q, again.metrics))
    )


def test_the_batch_is_the_single_environment_many_times(wrapped):
    wrapper, reset, step = wrapped
    keys = jax.random.split(jax.random.key(2), BATCH)
    batched = step(reset(keys), jnp.full((BATCH, 5), 0.3))
    single = jax.jit(wrapper.unwrapped.step)(wrapper.unwrapped.reset(keys[3]), jnp.full(5, 0.3))
    np.testing.assert_allclose(np.asarray(batched.obs[3]), np.asarray(single.obs), atol=1e-5)


def test_action_repeat_holds_the_action(wrapped):
    _, reset, step = wrapped
    keys = jax.random.split(jax.random.key(3), BATCH)
    action = jnp.full((BATCH, 5), -0.4)
    twice = step(step(reset(keys), action), action)
    wrapper = TrainingWrapper(CuttingEnv(EnvConfig()), episode_length=40, action_repeat=2)
    repeated = jax.jit(wrapper.step)(wrapper.reset(keys), action)
    np.testing.assert_allclose(np.asarray(repeated.obs), np.asarray(twice.obs), atol=1e-6)
    np.testing.assert_array_equal(np.asarray(repeated.info["steps"]), 2.0)


@pytest.mark.parametrize("bad", [{"episode_length": 0}, {"action_repeat": 0}])
def test_bad_lengths_are_refused(wrapped, bad):
    with pytest.raises(ValueError, match="at least 1"):
        TrainingWrapper(wrapped[0].unwrapped, **bad)


def test_randomization_functions_are_refused(wrapped):
    with pytest.raises(ValueError, match="draws its own conditions"):
        wrap_for_training(wrapped[0].unwrapped, randomization_fn=lambda system: system)


@pytest.mark.slow
def test_brax_trains_on_it():
    _platform.patch_brax()
    from brax.training.agents.ppo import train as ppo

    env = CuttingEnv(EnvConfig(approach_m=0.005, cut_m=0.03))
    _, _, metrics = ppo.train(
        environment=env,
        num_timesteps=4096,
        episode_length=100,
        num_envs=64,
        num_eval_envs=16,
        num_evals=2,
        unroll_length=8,
        batch_size=64,
        num_minibatches=2,
        num_updates_per_batch=2,
        normalize_observations=True,
        wrap_env_fn=wrap_for_training,
        seed=0,
    )
    assert np.isfinite(float(metrics["eval/episode_reward"]))
    assert float(metrics["eval/avg_episode_length"]) > 10.0
