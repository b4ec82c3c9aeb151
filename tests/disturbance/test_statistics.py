"""Trials reduced to rows, the noise they show, and bad input."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.disturbance.statistics import helmert, reduce, spread_noise


def _good(trials=4, stamps=60, axes=3):
    rng = np.random.default_rng(0)
    return np.arange(stamps) * 0.01, rng.normal(size=(trials, stamps, axes))


def test_helmert_is_orthonormal_and_averages_first():
    H = helmert(7)
    np.testing.assert_allclose(H @ H.T, np.eye(7), atol=1e-14)
    np.testing.assert_allclose(H[0], np.full(7, 7**-0.5))


def test_layouts():
    time, residual = _good()
    assert reduce(time, residual, False).effects == "pooled"
    assert reduce(time, residual).effects == "balanced"
    assert reduce(time, residual[:1]).effects == "pooled"
    residual[2, 50:] = np.nan
    reduced = reduce(time, residual)
    assert reduced.effects == "gaps"
    assert reduced.count == 4 * 60 - 10
    assert reduced.subset([0, 1]).effects == "balanced"


def test_scale_is_the_spread_and_one_dimension_is_one_trial():
    time, residual = _good(axes=1)
    reduced = reduce(time, 7.0 * residual[0, :, 0])
    assert reduced.trials == reduced.axes == 1
    assert np.std(reduced.residual) == pytest.approx(1.0)


def test_noise_ignores_both_the_signal_and_trial_effects(simulate):
    drawn = simulate(0, trials=8, noise=0.3, trial_amplitude=1.0)
    reduced = reduce(drawn.time_s, drawn.residual_n)
    np.testing.assert_allclose(spread_noise(reduced) * reduced.scale, 0.3, rtol=0.02)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda t, y: (t[::-1], y), "strictly increasing"),
        (lambda t, y: (t[:-1], y), "shared stamps"),
        (lambda t, y: (t, np.where(np.arange(60)[None, :, None] == 5, np.inf, y)), "infinite"),
        (lambda t, y: (t, np.concatenate([y, y], 2)), "1 to 3 axes"),
        (lambda t, y: (t, y * [1.0, 0.0, 1.0]), "axis 1 of the residual is constant"),
        (lambda t, y: (t[:5], y[:, :5]), "at least 8"),
        (lambda t, y: (t, np.where(np.arange(4)[:, None, None] == 1, np.nan, y)), "trial 1"),
        (
            lambda t, y: (t, np.where(np.arange(3) == 1, np.where(t[:, None] < 0.1, np.nan, y), y)),
            "some axes",
        ),
    ],
)
def test_bad_input_is_named(spoil, message):
    with pytest.raises(ValueError, match=message):
        reduce(*spoil(*_good()))
