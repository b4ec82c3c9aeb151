"""The peer on C MuJoCo is the same task: the same actions give the same episode, to its end."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.sim import CuttingEnv, EnvConfig
from mjx_cutting.sim.action import to_action
from mjx_cutting.sim.observation import SCALES
from mjx_cutting.sim.peers import GymCutting

ADDED = ("reward_mrv", "reward_path", "reward_force")

# every error of the sheet, the sensor and the robot is in it, large enough to show if one were left out
HARD = EnvConfig(
    approach_m=0.005,
    cut_m=0.03,
    force_noise_n=(0.0, 0.0, 0.0),
    force_average_samples=4,
    sheet_height_std_m=2e-4,
    sheet_slope_std=5e-3,
    sensor_bias_std_n=2.0,
    gain_error=0.2,
    payload_error_kg=0.2,
)


@pytest.fixture(scope="module")
def ours():
    env = CuttingEnv(HARD)
    return jax.jit(env.reset), jax.jit(env.step)


@pytest.fixture
def in_double():
    """A cut of a few um makes float32's rounding ten thousand times as large, and the last bit is not the
    same on every processor."""
    with _platform.x64():
        yield


def smooth_actions(seed, count):
    """[count, 5] a random walk that reaches every part of the ranges."""
    rng, action, out = np.random.default_rng(seed), np.zeros(5), []
    for _ in range(count):
        action = 0.9 * action + 0.4 * rng.normal(size=5)
        out.append(np.clip(action, -1.0, 1.0).astype(np.float32))
    return out


@pytest.mark.usefixtures("in_double")
@pytest.mark.parametrize("seed", (4, 11, 13))
def test_the_same_actions_give_the_same_episode(ours, seed):
    reset, step = ours
    peer = GymCutting(HARD)
    state = reset(jax.random.key(seed))
    assert state.obs.dtype == np.float64
    seen = [(np.asarray(state.obs), peer.reset(state.pipeline_state.episode))]
    sums = np.zeros((2, 4))
    for action in smooth_actions(seed, 1000):
        state = step(state, jnp.asarray(action))
        obs, reward, terminated, truncated, info = peer.step(action)
        seen.append((np.asarray(state.obs), obs))
        sums[0] += [*(float(state.metrics[name]) for name in ADDED), float(state.reward)]
        sums[1] += [*(info[name] for name in ADDED), reward]
        assert bool(state.done) == (terminated or truncated)
        if terminated or truncated:
            break
    assert terminated and not info["failed"]
    both = np.array(seen) * np.asarray(SCALES)
    apart = np.abs(both[:, 0] - both[:, 1])
    for columns, most in (
        (slice(1, 4), 1e-7),
        (slice(4, 7), 2e-6),
        (slice(7, 10), 2e-4),
        (slice(10, 15), 2e-6),
    ):
        assert apart[:, columns].max() < most
    assert sums[0, 0] > 1e-3
    np.testing.assert_allclose(sums[1], sums[0], rtol=1e-4, atol=1e-6)


def test_a_peer_given_nothing_draws_its_own_episodes():
    peer = GymCutting(HARD, seed=3)
    first = peer.episode
    np.testing.assert_allclose(peer.reset()[3:7], 0.0)
    assert float(first.payload_kg) != float(peer.episode.payload_kg)
    again = GymCutting(HARD, seed=3)
    assert float(again.episode.payload_kg) == float(first.payload_kg)


def test_a_saw_that_is_drawn_in_fails_in_both():
    # on mica the softest gain in depth cannot hold the saw against what pulls it in at the sheet's edge
    config = EnvConfig(cut_m=0.03, materials=("mica",), randomize=False, force_noise_n=(0.0, 0.0, 0.0))
    env = CuttingEnv(config)
    state, step = jax.jit(env.reset)(jax.random.key(0)), jax.jit(env.step)
    peer = GymCutting(config)
    peer.reset(state.pipeline_state.episode)
    action = to_action([400.0, 400.0, 50.0, 0.5, 0.002], env.action_limits).astype(np.float32)
    over, steps = False, 0
    while not over:
        state, steps = step(state, jnp.asarray(action)), steps + 1
        _, reward, over, _, info = peer.step(action)
        assert bool(state.done) == over
    assert float(state.metrics["failed"]) == 1.0 and info["failed"] and steps < 100
    assert reward < -4.9 and reward == pytest.approx(float(state.reward), abs=0.02)
    depths = config.surface_height_m - np.array(
        [state.pipeline_state.tcp_m[2], peer.data.site_xpos[peer.tcp][2]]
    )
    np.testing.assert_allclose(depths, config.max_depth_m, atol=1e-3)
