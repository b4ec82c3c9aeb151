import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.training.types import Transition

from mjx_cutting import _platform
from mjx_cutting.learning.ppo import PPO
from mjx_cutting.learning.settings import PPOConfig

SMALL = PPOConfig(
    steps=60_000,
    envs=64,
    unroll_length=16,
    minibatches=4,
    epochs=4,
    reward_scaling=1.0,
    learning_rate=3e-3,
    discount=0.95,
    hidden=(16,),
    value_hidden=(16,),
)


@functools.cache
def compiled(ppo):
    return jax.jit(ppo.initialise), _platform.jit(ppo.iterate)


@pytest.fixture(scope="module")
def small(point_env, batched):
    """One algorithm whose compiled functions the tests share."""
    return PPO(batched(point_env()), SMALL)


def train(ppo, seed=0, iterations=None):
    initialise, iterate = compiled(ppo)
    state = initialise(jax.random.PRNGKey(seed))
    history = []
    for _ in range(iterations or ppo.config.iterations):
        state, metrics = iterate(state)
        history.append({k: np.asarray(v) for k, v in metrics.items()})
    return state, history


def test_ppo_learns_the_known_answer(small):
    # The optimal linear feedback pays P |x|^2 with P of the Riccati equation, -0.845 on average from x in
    # [-1, 1]^2
    # (noise adds about 0.01); doing nothing pays 1 / (1 - 0.64) * 2/3 = 1.85, the random policy 4.
    _, history = train(small)
    assert history[0]["episode_return"] < -3
    assert np.mean([h["episode_return"] for h in history[-5:]]) > -1.0


def test_truncated_episode_bootstraps_and_terminated_does_not(point_env, batched):
    """With reward 1 for ever the value is 1 / (1 - gamma) however short the episodes, if they end by time."""

    class Constant(point_env):
        def reset(self, key):
            state = super().reset(key)
            return state.replace(obs=jnp.zeros(4), info={**state.info, "terminal_obs": jnp.zeros(4)})

        def step(self, state, action):
            state = super().step(state, action)
            info = {**state.info, "terminal_obs": jnp.zeros(4)}
            if self.ends:
                info = {**info, "terminated": state.done > 0, "truncated": jnp.zeros((), bool)}
            return state.replace(obs=jnp.zeros(4), reward=jnp.ones(()), info=info)

    config = dataclasses.replace(SMALL, discount=0.8, gae_lambda=1.0, unroll_length=8, learning_rate=1e-2)
    values = {}
    for ends in (False, True):
        env = Constant(length=4)
        env.ends = ends
        ppo = PPO(batched(env), config)
        state, _ = train(ppo, iterations=60)
        start = ppo.env.reset(jax.random.split(jax.random.PRNGKey(0), 1)).obs
        values[ends] = float(ppo.networks.value_network.apply(state.normalizer, state.params.value, start)[0])
    # the critic, which sees the time, extrapolates to the observation after the last step
    assert values[False] == pytest.approx(5.0, abs=0.8)
    # at the start of an episode of four steps, which the critic can tell: (1 - 0.8^4) / 0.2
    assert values[True] == pytest.approx((1 - 0.8**4) / 0.2, abs=0.1)


def test_value_of_the_terminal_observation_is_added_where_truncated_and_nowhere_else(point_env, batched):
    ppo = PPO(batched(point_env()), dataclasses.replace(SMALL, reward_scaling=2.0))
    state = jax.jit(ppo.initialise)(jax.random.PRNGKey(0))
    terminal = jax.tree_util.tree_map(
        lambda x: jax.random.normal(jax.random.PRNGKey(1), (3, *x.shape)), state.env.info["terminal_obs"]
    )
    truncated = jnp.zeros((3, 64), bool).at[1, 5].set(True)
    data = Transition(
        observation=None,
        action=None,
        reward=jnp.full((3, 64), 0.25),
        discount=None,
        next_observation=None,
        extras={"policy_extras": {}, "state_extras": {"truncated": truncated, "terminal_obs": terminal}},
    )
    after = ppo._bootstrap(state.normalizer, state.params.value, data)
    value = ppo.networks.value_network.apply(state.normalizer, state.params.value, terminal)
    # the value is that of rewards times reward_scaling
    expected = np.full((3, 64), 0.25)
    expected[1, 5] += 0.95 * value[1, 5] / 2.0
    np.testing.assert_allclose(after.reward, expected, rtol=1e-5)
    assert not np.any(after.extras["state_extras"]["truncation"])


def test_critic_sees_progress_and_time_and_sheet_and_the_border_of_episodes(point_env, batched):
    env = batched(point_env())
    state = env.reset(jax.random.split(jax.random.PRNGKey(0), 3))
    assert env.observation_size == {"state": (4,), "critic": (7,)}
    step = jax.jit(env.step)
    for i in range(1, 17):
        state = step(state, jnp.zeros((3, 2)))
        last = state.info["terminal_obs"]["critic"]
        np.testing.assert_allclose(last[:, 4:], [[i / 16, i * 0.002, 1]] * 3, rtol=1e-5)
        now = [[i / 16, i * 0.002, 1]] if i < 16 else [[0, 0, 1]]
        np.testing.assert_allclose(state.obs["critic"][:, 4:], now * 3, rtol=1e-5)
        np.testing.assert_array_equal(state.obs["critic"][:, :4], state.obs["state"])
    assert np.all(state.obs["state"] != state.info["terminal_obs"]["state"])


def test_same_seed_same_bits_and_another_seed_other_bits(small):
    one, two, other = (train(small, seed=s, iterations=3)[0] for s in (1, 1, 2))
    a, b, c = map(jax.tree_util.tree_leaves, (one, two, other))
    assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))
    assert not all(np.array_equal(x, y) for x, y in zip(a, c, strict=True))


def test_several_seeds_at_once_equal_each_alone(small):
    keys = jnp.stack([jax.random.PRNGKey(s) for s in (0, 1)])
    both = jax.jit(jax.vmap(small.initialise))(keys)
    iterate = _platform.jit(jax.vmap(small.iterate))
    for _ in range(3):
        both, _ = iterate(both)
    for i in (0, 1):
        alone, _ = train(small, seed=i, iterations=3)
        for x, y in zip(
            jax.tree_util.tree_leaves(both.params), jax.tree_util.tree_leaves(alone.params), strict=True
        ):
            np.testing.assert_allclose(x[i], y, atol=1e-4)


def test_one_compile_for_all_iterations(small):
    train(small, iterations=3)
    assert compiled(small)[1]._cache_size() == 1


def test_fresh_policy_is_modest(small):
    policy = small.initial_parameters(jax.random.PRNGKey(0)).params.policy
    normalizer = small.initial_parameters(jax.random.PRNGKey(0)).normalizer
    obs = {"state": 3 * jax.random.normal(jax.random.PRNGKey(1), (100, 4))}
    loc, scale = jnp.split(small.networks.policy_network.apply(normalizer, policy, obs), 2, axis=-1)
    assert jnp.max(jnp.abs(loc)) < 0.1
    np.testing.assert_allclose(jax.nn.softplus(scale), 0.5, atol=0.05)


def test_noise_is_held_for_half_the_training_and_then_fades(small):
    n = small.config.iterations
    logits = jnp.zeros((1, 4))  # mean 0, softplus(0) = log 2

    def std(iteration):
        networks = small._networks_with_noise(jnp.asarray(iteration, jnp.int32))
        return float(networks.parametric_action_distribution.create_dist(logits).scale[0, 0])

    full = np.log(2.0) + 1e-3
    assert std(0) == pytest.approx(full, rel=1e-5)
    assert std(n // 2) == pytest.approx(full, rel=1e-5)
    assert std(n * 3 / 4) == pytest.approx(0.65 * full, rel=0.05)
    assert std(n) == std(2 * n) == pytest.approx(0.3 * full, rel=1e-5)


def test_schedules_are_told_for_the_sake_of_resuming():
    assert PPOConfig().has_schedule
    assert not PPOConfig(noise_scale_final=1.0).has_schedule
    assert PPOConfig(noise_scale_final=1.0, learning_rate_final=0.0).has_schedule


def test_flags_name_what_is_not_finite(point_env, batched):
    ppo = PPO(batched(point_env(break_at=3)), SMALL)
    _, history = train(ppo, iterations=1)
    assert history[0]["finite_observation"].shape == (4,)
    assert history[0]["finite_observation"].all()
    assert not history[0]["finite_reward"]


def test_normaliser_learns_the_observations_and_can_be_frozen(small):
    state, _ = train(small, iterations=5)
    assert np.all(np.abs(state.normalizer.std["state"] / np.asarray([0.4, 0.4, 2.0, 2.0]) - 1) < 0.6)
    frozen = dataclasses.replace(small, freeze_normalizer=True)
    state, _ = train(frozen, iterations=2)
    np.testing.assert_array_equal(state.normalizer.std["state"], 1.0)


def test_an_entry_that_never_moves_is_not_amplified(point_env, batched):
    class Still(point_env):
        def _observe(self, x, d):
            clean, corrected = super()._observe(x, d)
            return clean.at[0].set(0.5), corrected.at[0].set(0.5)

    state, _ = train(PPO(batched(Still()), SMALL), iterations=2)
    assert state.normalizer.std["state"][0] == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("steps", 0),
        ("envs", 0),
        ("minibatches", 3),
        ("learning_rate", 0.0),
        ("learning_rate_final", -1.0),
        ("discount", 1.1),
        ("clip", 0.0),
        ("activation", "gelu"),
        ("hidden", (0,)),
        ("entropy_cost", -1.0),
    ],
)
def test_settings_out_of_range_are_refused(name, value):
    with pytest.raises(ValueError, match=rf"got {name}=.*expected .*; set --"):
        PPOConfig(**{name: value})


def test_iterations_reach_the_steps():
    config = PPOConfig(steps=1000, envs=16, unroll_length=8)
    assert config.steps_per_iteration == 128
    assert config.iterations == 8
    assert functools.reduce(lambda n, _: n + 128, range(8), 0) >= 1000
