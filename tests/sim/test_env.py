"""The environment: interface, reward, endings, guard, determinism, disturbance modes, and its two engines."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.cutting import ForceModel, Material, Tool, effect_class
from mjx_cutting.disturbance.posterior import PeriodicPosterior
from mjx_cutting.sim import CuttingEnv, EnvConfig, TrainingWrapper
from mjx_cutting.sim.baseline import baseline_action
from mjx_cutting.sim.env import METRICS
from mjx_cutting.sim.reward import TERMS

BATCH = 16


def actions(key, batch=BATCH):
    return jax.random.uniform(key, (batch, 5), minval=-1.0, maxval=1.0)


def posterior(amplitude=3.0):
    """A disturbance whose draws are plain sines of 2 Hz, the same for every draw but for the phase."""
    mean = np.zeros((3, 3))
    mean[1] = [amplitude, 0.5 * amplitude, 0.2 * amplitude]
    zero = np.zeros((3, 3, 3))
    return PeriodicPosterior.build(mean, zero, zero, np.full(3, 0.5), 2.0)


def test_interface(env, reset, step, state):
    assert (env.observation_size, env.action_size) == (15, 5)
    assert len(env.observation_names) == len(env.observation_units) == len(env.observation_scales) == 15
    limits = env.action_limits
    assert len(limits.names) == len(limits.low) == len(limits.high) == len(limits.rate) == 5
    after = step(state, jnp.zeros((BATCH, 5)))
    assert after.obs.shape == (BATCH, 15) and after.obs.dtype == jnp.float32
    assert after.reward.shape == after.done.shape == (BATCH,)
    assert set(after.metrics) == {*TERMS, *METRICS}
    for name in ("clean_obs", "terminated", "truncated", "terminal_obs", "material", "episode_sums"):
        assert name in after.info
    assert jax.tree.structure(after) == jax.tree.structure(state)
    for old, new in zip(jax.tree.leaves(state), jax.tree.leaves(after), strict=True):
        assert old.dtype == new.dtype and old.shape == new.shape


def test_reward_is_the_sum_of_its_terms_and_sums_add_up(step, state):
    total = np.zeros(BATCH)
    for key in jax.random.split(jax.random.key(3), 30):
        state = step(state, actions(key))
        terms = sum(np.asarray(state.metrics[name]) for name in TERMS)
        np.testing.assert_allclose(np.asarray(state.reward), terms, rtol=1e-5, atol=1e-7)
        total += np.asarray(state.reward)
    np.testing.assert_allclose(np.asarray(state.info["episode_sums"]["reward"]), total, rtol=1e-4)
    np.testing.assert_array_equal(np.asarray(state.info["episode_sums"]["steps"]), 30.0)
    assert np.all(np.asarray(state.metrics["reward_time"]) == pytest.approx(-0.05 * 0.02))


def test_setpoints_move_at_their_rates_and_stay_in_range(env, step, state):
    config = env.config
    up = jnp.ones((BATCH, 5))
    one = step(state, up).pipeline_state.setpoint[0] - state.pipeline_state.setpoint[0]
    assert float(one[3]) == pytest.approx(config.feed_rate_s * 0.02, rel=1e-4)
    assert float(one[4]) == pytest.approx(config.depth_rate_m_s * 0.02, rel=1e-4)
    for _ in range(60):
        state = step(state, up)
    reached = np.asarray(state.pipeline_state.setpoint[0])
    np.testing.assert_allclose(np.exp(reached[:3]), config.stiffness_s2[1], rtol=1e-4)
    np.testing.assert_allclose(reached[3:], [config.feed_adjustment[1], config.depth_m[1]], rtol=1e-5)
    np.testing.assert_allclose(float(state.obs[0, 10]), config.feed_adjustment[1], rtol=1e-5)


def test_same_seed_is_bit_identical_and_other_seeds_differ(reset, step):
    def play(seed):
        state = reset(jax.random.split(jax.random.key(seed), BATCH))
        for key in jax.random.split(jax.random.key(9), 20):
            state = step(state, actions(key))
        return np.asarray(state.obs)

    first, second, other = play(1), play(1), play(2)
    np.testing.assert_array_equal(first, second)
    assert np.abs(first - other).max() > 1e-3


def test_nothing_recompiles_with_new_content(env, reset):
    traced = []

    @jax.jit
    def step(state, action):
        traced.append(1)
        return jax.vmap(env.step)(state, action)

    for seed in range(3):
        state = reset(jax.random.split(jax.random.key(seed), BATCH))
        for key in jax.random.split(jax.random.key(seed + 10), 3):
            state = step(state, actions(key))
    assert len(traced) == 1


def test_the_baseline_finishes_a_short_path_and_cuts(reset):
    config = EnvConfig(approach_m=0.01, cut_m=0.02, materials=("plastic",), randomize=False)
    env = CuttingEnv(config)
    step = jax.jit(jax.vmap(env.step))
    state = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), 4))
    action = jnp.broadcast_to(jnp.asarray(baseline_action(config)), (4, 5))
    done = np.zeros(4, bool)
    for count in range(140):  # noqa: B007 (read after the loop)
        state = step(state, action)
        done = np.asarray(state.done) > 0
        if done.any():
            break
    # 30 mm at 12.5 mm/s
    assert count + 1 == pytest.approx(120, abs=1)
    assert done.all() and np.asarray(state.info["terminated"]).all()
    assert not np.asarray(state.info["truncated"]).any()
    sums = {name: np.asarray(value) for name, value in state.info["episode_sums"].items()}
    assert (sums["completed"] == 1.0).all() and (sums["failed"] == 0.0).all()
    assert (sums["mrv_mm3"] > 1.0).all() and (sums["mrv_mm3"] < 1e9 * 0.0016 * 0.001 * 0.03).all()
    heights = np.asarray(state.pipeline_state.heights)
    fresh = np.asarray(env.plant.workpiece.fresh(0.005))
    volume = (fresh - heights).sum(axis=1) * config.cell_m * config.kerf_m * 1e9
    np.testing.assert_allclose(sums["mrv_mm3"], volume, rtol=1e-3)


def test_out_of_time_is_truncation(state):
    env = CuttingEnv(EnvConfig(max_episode_s=0.1))
    step = jax.jit(env.step)
    state = jax.jit(env.reset)(jax.random.key(0))
    for _ in range(5):
        assert not bool(state.info["truncated"])
        state = step(state, jnp.zeros(5))
    assert bool(state.info["truncated"]) and not bool(state.info["terminated"]) and float(state.done) == 1.0
    np.testing.assert_array_equal(np.asarray(state.info["terminal_obs"]), np.asarray(state.obs))


def test_a_state_that_is_not_finite_is_masked_counted_and_ended(env, step, state):
    broken = np.asarray(state.pipeline_state.qd).copy()
    broken[3, 2] = np.nan
    poisoned = state.replace(pipeline_state=state.pipeline_state._replace(qd=jnp.asarray(broken)))
    after = step(poisoned, jnp.zeros((BATCH, 5)))
    assert np.isfinite(np.asarray(after.obs)).all() and np.isfinite(np.asarray(after.reward)).all()
    assert all(np.isfinite(np.asarray(value)).all() for value in after.metrics.values())
    nan = np.asarray(after.metrics["nan"])
    assert nan[3] == 1.0 and nan.sum() == 1.0
    assert float(after.reward[3]) == env.config.failure_reward
    assert bool(after.info["terminated"][3]) and float(after.done[3]) == 1.0
    assert float(after.done[2]) == 0.0


def test_nan_actions_do_no_harm(step, state):
    after = step(state, jnp.full((BATCH, 5), jnp.nan))
    assert np.isfinite(np.asarray(after.obs)).all() and float(after.metrics["nan"].sum()) == 0.0


def run(env, count=40, seed=0, action=None):
    """[count] states of a batch of four under one action, deep in the sheet."""
    step, out = jax.jit(jax.vmap(env.step)), []
    state = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(seed), 4))
    action = jnp.asarray(baseline_action(env.config)) if action is None else action
    for _ in range(count):
        state = step(state, jnp.broadcast_to(action, (4, 5)))
        out.append(state)
    return out


SHORT = {"approach_m": 0.002, "materials": ("plastic",), "depth_rate_m_s": 0.02}


def test_observation_disturbance_leaves_the_robot_alone():
    plain = run(CuttingEnv(EnvConfig(**SHORT)))
    observed = run(
        CuttingEnv(
            EnvConfig(**SHORT, disturbance_mode="observation", disturbance_draw="mean"), None, posterior()
        )
    )
    seen = np.stack([np.asarray(s.obs) for s in observed])
    clean = np.stack([np.asarray(s.info["clean_obs"]) for s in observed])
    gap = (seen - clean)[..., 7:10] * 10.0
    np.testing.assert_array_equal((seen - clean)[..., :7], 0.0)
    np.testing.assert_array_equal((seen - clean)[..., 10:], 0.0)
    # process x (3 N) is base -y, process y (1.5 N) base -z, process z (.6 N) base x
    assert 2.5 < np.abs(gap[..., 1]).max() < 3.01
    np.testing.assert_allclose(gap[-20:, :, 2], 0.5 * gap[-20:, :, 1], atol=0.02)
    np.testing.assert_allclose(gap[-20:, :, 0], -0.2 * gap[-20:, :, 1], atol=0.02)
    motion = [np.asarray(s.pipeline_state.q) for s in plain]
    np.testing.assert_array_equal(np.stack(motion), [np.asarray(s.pipeline_state.q) for s in observed])
    np.testing.assert_array_equal(plain[-1].reward, observed[-1].reward)


def test_in_double_precision_the_state_is_double_and_stays_so():
    config = EnvConfig(**SHORT, disturbance_mode="dynamics")
    with _platform.x64():
        env = TrainingWrapper(CuttingEnv(config, None, posterior()), episode_length=4)
        first = env.reset(jax.random.split(jax.random.key(0), 2))
        act = jnp.ones((2, 5))
        last, _ = jax.lax.scan(lambda state, _: (env.step(state, act), None), first, None, 6)
    assert last.obs.dtype == last.reward.dtype == last.pipeline_state.heights.dtype == jnp.float64
    assert np.isfinite(np.asarray(last.obs)).all()


def test_dynamics_disturbance_moves_the_robot():
    plain = run(CuttingEnv(EnvConfig(**SHORT)))[-1]
    config = EnvConfig(**SHORT, disturbance_mode="dynamics", disturbance_draw="mean")
    moved = run(CuttingEnv(config, None, posterior()))[-1]
    gap = np.asarray(moved.pipeline_state.tcp_m) - np.asarray(plain.pipeline_state.tcp_m)
    assert 1e-5 < np.abs(gap).max() < 5e-3


def test_drawn_noise_is_added_with_function_noise():
    config = EnvConfig(**SHORT, disturbance_mode="observation", disturbance_draw="function_noise")
    states = run(CuttingEnv(config, None, posterior(0.0)))[20:]
    gap = np.stack([np.asarray(s.obs - s.info["clean_obs"])[:, 7:10] for s in states]) * 10.0
    # noise of .5 N a sample, mean of ten samples, only in contact
    assert 0.05 < gap.std() < 0.3


def test_a_model_with_an_effect_plugs_in():
    kind = effect_class("radial_runout")
    steel = Material.from_n_mm(K_tc=50.0, K_te=6.0, K_rc=15.0, K_re=4.0)
    saw = Tool("slitting_saw", 20, 0.05)
    config = EnvConfig(**{**SHORT, "materials": ("model",)}, randomize=False)
    with_runout = ForceModel(saw, steel, (kind(offset_m=jnp.float32(2e-5), angle_rad=jnp.float32(0.3)),))
    plain = run(CuttingEnv(config, ForceModel(saw, steel)))
    runout = run(CuttingEnv(config, with_runout))
    force = [
        np.stack([np.asarray(s.info["clean_obs"])[:, 8] for s in states])[20:] for states in (plain, runout)
    ]
    assert np.isfinite(force[1]).all()
    # teeth that do not touch rub nothing, so the mean force falls; and it varies with the turn of the spindle
    assert abs(force[1].mean()) < abs(force[0].mean())
    assert force[1].std() > 1.2 * force[0].std()


def test_engines_agree_over_a_cut():
    """To rounding; where that makes a tooth or a joint meet its stop one step earlier, the kick is another by
    less than a millimetre at the saw, and dies away."""
    config = EnvConfig(**SHORT, randomize=True)
    fused, mjx = CuttingEnv(config), CuttingEnv(dataclasses.replace(config, engine="mjx"))
    states, joints = [], []
    for env in (fused, mjx):
        step = _platform.jit(jax.vmap(env.step))
        state = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(4), 4))
        joints.append([])
        for key in jax.random.split(jax.random.key(5), 60):
            state = step(state, actions(key, 4))
            joints[-1].append(np.asarray(state.pipeline_state.q))
        states.append(state)
    a, b = states
    apart = np.abs(np.subtract(*joints)).max(axis=-1)  # [steps, cuts]
    assert np.quantile(apart, 0.8) < 5e-6
    assert apart.max() < 1e-3
    same = apart.max(axis=0) < 5e-6
    assert same.sum() >= 2
    np.testing.assert_allclose(a.obs[same], b.obs[same], atol=5e-3)
    np.testing.assert_allclose(a.obs, b.obs, atol=0.2)
    np.testing.assert_allclose(a.info["episode_sums"]["reward"], b.info["episode_sums"]["reward"], rtol=1e-2)


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: CuttingEnv(EnvConfig(disturbance_mode="observation")), "no disturbance is given"),
        (lambda: CuttingEnv(EnvConfig(materials=("model",))), "no force model is given"),
        (lambda: CuttingEnv(EnvConfig(start_m=(1.5, 0.3))), "cannot hold the saw"),
    ],
)
def test_what_does_not_fit_together_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
