"""A factor of each trial's own is what sheets and sensors scatter by, or if large something unexplained."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing import trace
from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.telling.own_factor import followed, own_factors

SCATTER = np.array([1.0, 1.1, 0.9, -1.2, -0.8, -1.1])


@pytest.mark.parametrize(("size", "word"), [(0.009, "nothing missing"), (0.05, "unexplained")])
def test_a_factor_no_larger_than_trials_repeat_is_nothing_missing(mill, size, word):
    made = mill(zeroed="session")
    trials = [
        replace(t, force_n=(1.0 + size * own) * t.force_n)
        for t, own in zip(made.trials, SCATTER, strict=True)
    ]
    verdict = trace(
        replace(made, trials=tuple(trials)), effects=["radial_runout", "flank_wear", "crosstalk"]
    ).verdict
    assert verdict["verdict"] == word and verdict["effects"] == []
    assert verdict["before"]["heldout_nrmse"] > 1.5 * verdict["noise_floor_nrmse"]
    if word == "unexplained":
        assert verdict["remaining"]["depends_on"] == ["trial"]
    else:
        assert "larger or smaller as a whole" in verdict["remaining"]["description"]


def test_what_is_left_without_the_factors_is_what_was_there_before_them():
    generator = np.random.default_rng(0)
    force = generator.normal(size=(4, 500, 3))
    noise = 0.1 * generator.normal(size=(4, 500, 3))
    bias = np.array([3.0, -2.0, 5.0])
    factor = np.array([0.1, -0.2, 0.0, 0.05])
    time = 0.01 * np.arange(500)
    seen = [
        Prediction("a.csv", time, time, (1.0 + own) * each + rest + bias, each + bias, 1.0, bias)
        for own, each, rest in zip(factor, force, noise, strict=True)
    ]
    found = own_factors(seen)
    np.testing.assert_allclose(found.factor, factor, atol=0.01)
    whole = sum(float(np.sum(each.residual_n**2)) for each in seen)
    left = sum(float(np.sum(each.residual_n**2)) for each in found.without)
    assert left == pytest.approx(float(np.sum(noise**2)), rel=0.01)
    assert found.share == pytest.approx(1.0 - left / whole, rel=0.01)


def test_of_a_trial_whose_lines_lie_above_the_band_the_factor_is_that_of_its_mean():
    """Many teeth at once leave a steady force in the third; one zero of the sensor serves all."""
    time = 0.01 * np.arange(500)
    wave = np.sin(2.0 * np.pi * 3.0 * time)[:, None] * np.ones(3)
    noise = 0.01 * np.random.default_rng(0).normal(size=(3, 500, 3))
    factor, force = np.array([0.04, -0.04, 0.04]), [10.0 + 5.0 * wave, 10.0 + 5.0 * wave, 10.0 + 0.0 * wave]
    seen = [
        Prediction("a.csv", time, time, (1.0 + own) * each + rest, each, 1.0, np.zeros(3))
        for own, each, rest in zip(factor, force, noise, strict=True)
    ]
    found = own_factors(seen)
    np.testing.assert_allclose(found.factor, factor, atol=1e-3)
    assert found.share > 0.99


def test_a_trial_whose_lines_lie_above_the_band_tells_no_factor_where_each_has_a_zero_of_its_own():
    """What is left of the wave there is rounding, and a thousandth of noise over that would be any factor."""
    time = 0.01 * np.arange(500)
    wave = np.sin(2.0 * np.pi * 3.0 * time)[:, None] * np.ones(3)
    noise = 0.01 * np.random.default_rng(0).normal(size=(3, 500, 3))
    own = zip((0.04, -0.04, 0.04), (5.0 * wave, 5.0 * wave, 1e-9 * wave), (1.0, 2.0, 3.0), noise, strict=True)
    seen = [
        Prediction(
            "a.csv", time, time, bias + (1.0 + factor) * each + rest, bias + each, 1.0, np.full(3, bias)
        )
        for factor, each, bias, rest in own
    ]
    found = own_factors(seen)
    np.testing.assert_allclose(found.factor, [0.04, -0.04, 0.0], atol=1e-3)
    assert found.size == pytest.approx(0.04, rel=0.02)


@pytest.mark.parametrize(("share", "size", "surely"), [(1.0, 1, True), (0.9, 1, False), (0.999, 4, False)])
def test_factors_that_an_effect_of_few_unknowns_follows_closely_are_no_scatter(share, size, surely):
    """Of seven trials: by chance one unknown follows nine tenths of them now and then, four nearly all."""
    force = np.random.default_rng(1).normal(size=(7, 400, 3))
    factor = 0.01 * np.append(SCATTER, 0.7)[:, None, None]

    time, zero = 0.01 * np.arange(400), np.zeros(3)

    def left(rest: float) -> list[Prediction]:
        whole = zip(force, rest * factor * force, strict=True)
        return [Prediction("a.csv", time, time, shape + more, shape, 1.0, zero) for shape, more in whole]

    assert followed(left(1.0), left(np.sqrt(1.0 - share)), size) is surely
