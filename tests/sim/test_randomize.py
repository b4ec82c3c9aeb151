"""Every draw follows its stated distribution, purely from its key."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.cutting import Material
from mjx_cutting.sim import EnvConfig, randomize
from mjx_cutting.sim.materials import MATERIALS

COUNT = 4000


@pytest.fixture(scope="module")
def drawn():
    config = EnvConfig()
    keys = jax.random.split(jax.random.key(0), COUNT)
    return config, jax.tree.map(np.asarray, jax.jit(jax.vmap(lambda key: randomize.draw(key, config)))(keys))


@pytest.mark.parametrize("name", list(MATERIALS))
def test_constants_stay_in_their_ranges(drawn, name):
    config, episode = drawn
    here = episode.material_index == config.materials.index(name)
    limits, material = MATERIALS[name], episode.material
    assert here.mean() == pytest.approx(0.2, abs=0.03)
    for value, (low, high) in (
        (material.K_tc_n_m2[here] / 1e6, limits.K_tc_n_mm2),
        (material.K_te_n_m[here] / 1e3, limits.K_te_n_mm),
        (material.K_re_n_m[here] / material.K_te_n_m[here], limits.edge_ratio),
    ):
        assert low * 0.999 <= value.min() and value.max() <= high * 1.001
        # log-uniform: the median is the geometric mean of the bounds
        spread = np.log(high / low)
        assert np.median(np.log(value / np.sqrt(low * high))) == pytest.approx(0.0, abs=0.08 * spread)
    ratio = material.K_rc_n_m2[here] / material.K_tc_n_m2[here]
    assert np.median(ratio) == pytest.approx(0.35, abs=0.04)
    np.testing.assert_allclose(episode.thickness_m[here], limits.thickness_m, rtol=1e-6)


def test_errors_have_their_spread(drawn):
    config, episode = drawn
    for value, spread in (
        (episode.sheet_height_m, config.sheet_height_std_m),
        (episode.sheet_slope, config.sheet_slope_std),
        (episode.bias_n, config.sensor_bias_std_n),
        (episode.gain_factor - 1.0, config.gain_error / np.sqrt(3.0)),
        (episode.payload_kg, config.payload_error_kg / np.sqrt(3.0)),
        (episode.spindle_angle_rad - np.pi, 2.0 * np.pi / np.sqrt(12.0)),
    ):
        assert value.std() == pytest.approx(spread, rel=0.06)
        assert value.mean() == pytest.approx(0.0, abs=0.08 * spread)


def test_draws_are_independent(drawn):
    _, episode = drawn
    columns = [episode.sheet_height_m, episode.sheet_slope, episode.payload_kg, episode.spindle_angle_rad]
    columns += [*episode.bias_n.T, *episode.gain_factor.T]
    correlation = np.corrcoef(columns) - np.eye(len(columns))
    assert np.abs(correlation).max() < 0.08


def test_it_is_pure_and_can_be_switched_off():
    config = EnvConfig(randomize=False)
    one, two = (randomize.draw(jax.random.key(7), config) for _ in range(2))
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(two), strict=True):
        np.testing.assert_array_equal(a, b)
    assert float(one.payload_kg) == float(one.sheet_height_m) == 0.0
    np.testing.assert_array_equal(np.asarray(one.gain_factor), 1.0)


def test_the_constants_of_a_model_take_part():
    given = Material(1e8, 2e4, 3e7, 8e3)
    config = EnvConfig(materials=("foam", "model"))
    keys = jax.random.split(jax.random.key(0), 64)
    episode = jax.vmap(lambda key: randomize.draw(key, config, given))(keys)
    own = np.asarray(episode.material_index) == 1
    assert 10 < own.sum() < 54
    np.testing.assert_allclose(np.asarray(episode.material.K_te_n_m)[own], 2e4)
    assert (np.asarray(episode.material.K_te_n_m)[~own] < 1.1e4).all()
    with pytest.raises(ValueError, match="no force model is given"):
        randomize.draw(jax.random.key(0), config)


def test_any_trace_of_the_key_differs():
    config = EnvConfig()
    a, b = (randomize.draw(jax.random.key(seed), config) for seed in (0, 1))
    assert float(jnp.abs(a.spindle_angle_rad - b.spindle_angle_rad)) > 0.0
