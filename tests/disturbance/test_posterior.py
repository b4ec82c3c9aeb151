"""Draws in the graph: phase arithmetic, agreement with the float64 process, statistics, no factorisation."""

from __future__ import annotations

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.disturbance.posterior import MODES, PeriodicPosterior, evaluate


def _posterior(frequency_hz=19.123456789, harmonics=8, seed=0):
    rng = np.random.default_rng(seed)
    m = 2 * harmonics + 1
    fall = np.exp(-0.3 * np.r_[0, np.tile(np.arange(1, harmonics + 1), 2)])
    mean = rng.normal(size=(m, 3)) * fall[:, None]
    factor = 0.1 * np.stack([np.diag(fall)] * 3)
    return PeriodicPosterior.build(mean, factor, 3.0 * factor, [0.1, 0.2, 0.3], frequency_hz)


def _direct(posterior, draw, time_s, frequency_hz):
    J = posterior.harmonics
    angle = 2 * np.pi * np.outer(np.mod(time_s * frequency_hz, 1.0), np.arange(1, J + 1))
    phi = np.concatenate([np.ones((len(angle), 1)), np.cos(angle), np.sin(angle)], 1)
    return phi @ np.asarray(draw.weights, np.float64)


@pytest.mark.parametrize("frequency_hz", [19.123456789, 0.4321, 380.00001, 1.1e-3, 2.0])
@pytest.mark.parametrize("dt_s", [0.002, 0.02, 1 / 3])
def test_the_increment_is_exact_integer_arithmetic(frequency_hz, dt_s):
    posterior = _posterior(frequency_hz)
    got = int(jax.jit(lambda p: p.increment(dt_s))(posterior))
    assert got == round(Fraction(frequency_hz) * Fraction(dt_s) * 2**32) % 2**32
    single = np.float32(dt_s)
    traced = int(jax.jit(lambda p, d: p.increment(d))(posterior, single))
    assert traced == round(Fraction(frequency_hz) * Fraction(float(single)) * 2**32) % 2**32


def test_phase_error_after_2500_steps_and_beyond():
    frequency, dt = 19.123456789, 0.002
    posterior = _posterior(frequency)
    draw = posterior.draw(jax.random.key(0), "mean", random_phase=False)
    step = jax.jit(lambda d, n: jax.lax.fori_loop(0, n, lambda _, e: posterior.advance(e, dt), d))
    for steps, bound in ((2500, 1e-5), (25000, 1e-5)):
        turns = float(Fraction(frequency) * Fraction(dt) * steps % 1)
        error = (int(step(draw, steps).phase) / 2**32 - turns + 0.5) % 1.0 - 0.5
        assert abs(error) < bound


def test_a_run_equals_the_direct_sum_in_float64():
    posterior = _posterior()
    draw = posterior.draw(jax.random.key(1), "new_trial", random_phase=False)

    def step(d, _):
        return posterior.advance(d, 0.002), posterior.value(d)

    _, run = jax.jit(lambda d: jax.lax.scan(step, d, None, length=2500))(draw)
    expected = _direct(posterior, draw, np.arange(2500) * 0.002, 19.123456789)
    assert run.dtype == jnp.float32
    np.testing.assert_allclose(run, expected, atol=3e-5)


def test_modes():
    posterior = _posterior()
    keys = jax.random.split(jax.random.key(2), 4000)
    draws = {m: jax.vmap(lambda k, m=m: posterior.draw(k, m, random_phase=False))(keys) for m in MODES}
    for mode, factor in (("function", posterior.factor), ("new_trial", posterior.trial_factor)):
        weights = np.asarray(draws[mode].weights)
        np.testing.assert_allclose(weights.mean(0), posterior.mean, atol=0.02)
        spread = np.sqrt(np.einsum("aij,aij->ai", factor, factor)).T
        np.testing.assert_allclose(weights.std(0), spread, rtol=0.06)
    np.testing.assert_array_equal(draws["mean"].weights[7], posterior.mean)
    np.testing.assert_array_equal(draws["function_noise"].weights, draws["function"].weights)
    with pytest.raises(ValueError, match=r"'white'.*mean, function, function_noise, new_trial"):
        posterior.draw(keys[0], "white")


def test_noise_is_added_only_when_asked_for():
    posterior = _posterior()
    draw = posterior.draw(jax.random.key(0), "function_noise")
    clean = posterior.value(draw)
    noisy = jax.vmap(lambda k: posterior.value(draw, k))(jax.random.split(jax.random.key(1), 20000))
    np.testing.assert_allclose(noisy.mean(0), clean, atol=0.01)
    np.testing.assert_allclose((noisy - clean).std(0), [0.1, 0.2, 0.3], rtol=0.03)


def test_random_phases_are_spread_over_the_turn_and_one_function_is_kept():
    posterior = _posterior()
    draws = jax.vmap(posterior.draw)(jax.random.split(jax.random.key(3), 2000))
    counts = np.histogram(np.asarray(draws.phase) / 2**32, bins=10, range=(0, 1))[0]
    assert counts.min() > 130
    one = jax.tree.map(lambda v: v[0], draws)
    later = posterior.advance(one, 0.002)
    np.testing.assert_array_equal(later.weights, one.weights)
    # a smooth function, not fresh noise each step
    assert (
        float(jnp.max(jnp.abs(posterior.value(posterior.advance(one, 1e-5)) - posterior.value(one)))) < 0.02
    )


def test_vmap_equals_a_loop_and_stacked_posteriors_work():
    pair = [_posterior(3.0, seed=1), _posterior(7.0, seed=2)]
    stacked = jax.tree.map(lambda *v: jnp.stack(v), *pair)
    keys = jax.random.split(jax.random.key(0), 2)

    def later(p, k):
        return p.value(p.advance(p.draw(k), 0.01))

    together = jax.jit(jax.vmap(later))(stacked, keys)
    for i in range(2):
        np.testing.assert_allclose(together[i], later(pair[i], keys[i]), rtol=1e-6, atol=1e-6)
    assert stacked.harmonics == 8


def test_no_factorisation_in_reset_or_step():
    posterior = _posterior()

    def episode(p, key):
        draw = p.draw(key)
        return p.value(p.advance(draw, 0.002))

    text = (
        jax.jit(jax.vmap(episode, (None, 0)))
        .lower(posterior, jax.random.split(jax.random.key(0), 8))
        .as_text()
    )
    for name in ("lapack", "cholesky", "potrf", "triangular_solve"):
        assert name not in text.lower()


def test_evaluate_is_accurate_for_many_harmonics():
    rng = np.random.default_rng(5)
    weights = rng.normal(size=(129, 3)).astype(np.float32)
    phase = rng.integers(0, 2**32, 500, dtype=np.uint32)
    got = jax.vmap(evaluate, (None, 0))(jnp.asarray(weights), jnp.asarray(phase))
    angle = 2 * np.pi * np.outer(phase / 2**32, np.arange(1, 65))
    phi = np.concatenate([np.ones((500, 1)), np.cos(angle), np.sin(angle)], 1)
    np.testing.assert_allclose(got, phi @ weights.astype(np.float64), atol=2e-4)


def test_bad_parts_are_refused():
    good = {
        "mean": np.zeros((5, 3)),
        "factor": np.zeros((3, 5, 5)),
        "trial_factor": np.zeros((3, 5, 5)),
        "noise_std_n": np.zeros(3),
        "frequency_hz": 1.0,
    }
    with pytest.raises(ValueError, match="shapes"):
        PeriodicPosterior.build(**{**good, "mean": np.zeros((4, 3))})
    with pytest.raises(ValueError, match="not finite"):
        PeriodicPosterior.build(**{**good, "noise_std_n": np.array([0, np.nan, 0])})
    with pytest.raises(ValueError, match="frequency"):
        PeriodicPosterior.build(**{**good, "frequency_hz": 0.0})
