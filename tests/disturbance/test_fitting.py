"""Known trials in, known process out: hyperparameters, coverage, warnings and refusals."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest

import mjx_cutting.disturbance as disturbance
from mjx_cutting.disturbance import fitting, search
from mjx_cutting.disturbance.likelihood import Hyper, log_likelihood
from mjx_cutting.disturbance.statistics import reduce

SMALL = {"trials": 6, "stamps": 500, "rate_hz": 100.0, "axes": 2}


@pytest.fixture(scope="module")
def fitted(simulate):
    drawn = simulate(3, **SMALL)
    return drawn, disturbance.fit(drawn.time_s, drawn.residual_n, diagnose=False)


def test_finds_the_truth_within_its_errors(fitted):
    drawn, gp = fitted
    error = gp.standard_errors["frequency_hz"]
    assert abs(gp.frequency_hz - drawn.frequency_hz) < 4 * error < 0.02
    np.testing.assert_allclose(gp.noise_std_n, 0.6, rtol=0.06)
    np.testing.assert_allclose(gp.trial_amplitude_n, 0.5, rtol=0.4)
    assert gp.standard_errors["period_s"] == pytest.approx(error / gp.frequency_hz**2)
    assert gp.trial_effects and gp.trials == 6 and gp.samples == 3000
    assert not gp.warnings


def test_is_at_least_as_likely_as_the_truth(fitted, x64):
    drawn, gp = fitted
    reduced = reduce(drawn.time_s, drawn.residual_n)
    one = np.ones(2)
    scale = reduced.scale
    truth = Hyper(2.13, 0.5 * one, 1.0 / scale, 0.6 * one, 0.5 / scale, 0.6 / scale)
    true = log_likelihood(truth, search.rows_of(reduced), "balanced", 32)
    true = float(true) - reduced.count * np.sum(np.log(scale))
    assert gp.log_likelihood > true - 0.5


def test_posterior_mean_is_the_dense_one(fitted, periodic):
    drawn, gp = fitted
    t = drawn.time_s[::5]
    y = drawn.residual_n[:, ::5, 0]
    trials, n = y.shape
    stamps, who = np.tile(t, trials), np.repeat(np.arange(trials), n)
    common = periodic(stamps, stamps, gp.length[0], gp.amplitude_n[0], gp.frequency_hz)
    own = periodic(stamps, stamps, gp.trial_length[0], gp.trial_amplitude_n[0], gp.frequency_hz)
    K = common + own * (who[:, None] == who[None, :]) + gp.noise_std_n[0] ** 2 * np.eye(len(stamps))
    test = np.linspace(4.0, 9.0, 23)
    cross = periodic(test, stamps, gp.length[0], gp.amplitude_n[0], gp.frequency_hz)
    mean = cross @ np.linalg.solve(K, y.ravel())
    prior = periodic(test, test, gp.length[0], gp.amplitude_n[0], gp.frequency_hz)
    variance = np.diag(prior - cross @ np.linalg.solve(K, cross.T))
    fresh = variance + gp.trial_amplitude_n[0] ** 2

    from mjx_cutting.disturbance import weights
    from mjx_cutting.disturbance.kernel import fourier
    from mjx_cutting.disturbance.kernel import prior as diagonal

    S0 = gp.amplitude_n[0] ** 2 * diagonal(gp.length[0], 32)
    S1 = gp.trial_amplitude_n[0] ** 2 * diagonal(gp.trial_length[0], 32)
    phi = fourier(t, gp.frequency_hz, 32)
    for gaps in (False, True):
        found = weights.condition(phi, y[..., None], (S0[None], S1[None]), gp.noise_std_n[:1], True)
        at = fourier(test, gp.frequency_hz, 32)
        np.testing.assert_allclose(at @ found.mean[0], mean, atol=1e-8)
        np.testing.assert_allclose(np.sum((at @ found.factor[0]) ** 2, 1), variance, rtol=1e-7)
        np.testing.assert_allclose(np.sum((at @ found.trial_factor[0]) ** 2, 1), fresh, rtol=1e-7)
        if gaps:
            break
        y = y.copy()
        y[2, 60:] = np.nan
        seen = np.isfinite(y.ravel())
        mean = cross[:, seen] @ np.linalg.solve(K[np.ix_(seen, seen)], y.ravel()[seen])
        drop = cross[:, seen] @ np.linalg.solve(K[np.ix_(seen, seen)], cross[:, seen].T)
        variance = np.diag(prior - drop)
        fresh = variance + gp.trial_amplitude_n[0] ** 2


def test_the_simulations_form_agrees_with_the_host(fitted):
    import jax

    _drawn, gp = fitted
    posterior = gp.posterior()
    assert posterior.harmonics < gp.harmonics  # a smooth disturbance is cheap
    draw = posterior.draw(jax.random.key(0), "mean", random_phase=False)
    mean, spread = gp.predict(np.array([0.0]))
    value = np.asarray(posterior.value(draw))
    np.testing.assert_allclose(value[:2], mean[0], atol=1e-4)
    assert value[2] == 0.0  # an axis that was not fitted
    draws = jax.vmap(lambda k: posterior.draw(k, random_phase=False))(
        jax.random.split(jax.random.key(1), 5000)
    )
    np.testing.assert_allclose(np.asarray(jax.vmap(posterior.value)(draws)).std(0)[:2], spread[0], rtol=0.06)


def test_one_trial_and_pooled(simulate):
    drawn = simulate(4, trials=1, trial_amplitude=0.0, stamps=500, rate_hz=100.0, axes=2)
    gp = disturbance.fit(drawn.time_s, drawn.residual_n, axes=("y", "z"), diagnose=False)
    assert gp.axes == ("y", "z") and not gp.trial_effects
    assert abs(gp.frequency_hz - 2.13) < 4 * gp.standard_errors["frequency_hz"]
    mean, spread = gp.predict(drawn.time_s)
    assert np.mean(np.abs(mean[:, 0] - drawn.common_n[:, 0]) < 2 * spread[:, 0]) > 0.8
    np.testing.assert_array_equal(gp.predict(drawn.time_s, "function")[0], mean)


def test_trials_without_a_common_part_keep_their_size():
    """The bands are those of the trials, not of the constant that a nearly sinusoidal kernel asks for."""
    rng = np.random.default_rng(0)
    time = np.arange(500) * 0.01
    phase = rng.uniform(0.0, 2.0 * np.pi, (6, 1, 1))
    wave = 3.0 * np.sin(2.0 * np.pi * 2.1 * time[None, :, None] + phase)
    residual = wave + 0.3 * rng.normal(size=(6, 500, 2))
    gp = disturbance.fit(time, residual, frequency_range_hz=(0.8, 5.0), diagnose=False)
    _, spread = gp.predict(time)
    size = 3.0 / np.sqrt(2.0)
    np.testing.assert_allclose(spread.mean(0), size, rtol=0.3)
    np.testing.assert_allclose(gp.trial_std_n, size, rtol=0.3)
    assert np.max(gp.common_std_n) < 0.1 * size and not gp.warnings
    lifted = disturbance.fit(time, residual + 4.0, frequency_range_hz=(0.8, 5.0), diagnose=False)
    mean, spread = lifted.predict(time)
    np.testing.assert_allclose(mean.mean(0), 4.0, rtol=0.05)  # a constant that is there stays
    np.testing.assert_allclose(spread.mean(0), size, rtol=0.3)


def test_a_band_wider_than_the_trials_is_said(fitted):
    drawn, gp = fitted
    wide = dataclasses.replace(gp, weights_trial_factor_n=9.0 * gp.weights_trial_factor_n)
    reduced = reduce(drawn.time_s, drawn.residual_n)
    said = fitting._loose_warnings(wide, reduced)
    assert len(said) == 2 and "Use more trials" in said[0] and not fitting._loose_warnings(gp, reduced)


@pytest.mark.slow
def test_gaps_at_the_ends_change_little(fitted):
    drawn, whole = fitted
    residual = drawn.residual_n.copy()
    residual[1, 450:] = np.nan
    gp = disturbance.fit(drawn.time_s, residual, diagnose=False)
    assert gp.samples == 3000 - 50
    assert gp.frequency_hz == pytest.approx(whole.frequency_hz, abs=4 * whole.standard_errors["frequency_hz"])
    np.testing.assert_allclose(gp.amplitude_n, whole.amplitude_n, rtol=0.2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frequency_range_hz": (0.1, 5.0)}, "fits less than 2 times"),
        ({"frequency_range_hz": (1.0, 60.0)}, "alias"),
        ({"frequency_range_hz": (5.0, 1.0)}, "0 < low < high"),
        ({"axes": ("x", "w")}, "distinct names"),
        ({"noise_std_n": [0.1, -1.0]}, "above 0 N"),
    ],
)
def test_bad_options_are_refused(fitted, options, message):
    drawn, _ = fitted
    with pytest.raises(ValueError, match=message):
        disturbance.fit(drawn.time_s, drawn.residual_n, **options)


def test_no_hang_on_two_cores_without_flags():
    """jaxlib's batched LAPACK can wait for the pool it runs in; a fit in a bare process must end."""
    program = (
        "import numpy as np, mjx_cutting.disturbance as d\n"
        "t = np.arange(500) * 0.01\n"
        "y = np.sin(2*np.pi*2.2*t)[None,:,None] + 0.3*np.random.default_rng(0).normal(size=(6,500,2))\n"
        "gp = d.fit(t, y, diagnose=False)\n"
        "assert abs(gp.frequency_hz - 2.2) < 0.02, gp.frequency_hz\n"
        "print('ended')\n"
    )
    keep = {k: v for k, v in os.environ.items() if k not in ("XLA_FLAGS", "OPENBLAS_NUM_THREADS")}
    ran = subprocess.run(
        [sys.executable, "-c", program], env=keep, capture_output=True, text=True, timeout=300, check=False
    )
    assert ran.returncode == 0 and "ended" in ran.stdout, ran.stderr[-2000:]
