"""Strikes at a rate of their own are told by what that rate goes with; chatter is not of them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mjx_cutting.tracing.along.own_rate import OwnRate, own_rate
from mjx_cutting.tracing.fitting.prediction import Prediction

RATE_HZ, SECONDS = 2000.0, 2.0
TIME = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
PLAN = [(12.0, 1.2e-3), (12.0, 2.4e-3), (16.0, 1.6e-3), (16.0, 3.2e-3), (20.0, 2.0e-3), (20.0, 1.0e-3)]


def _struck(at_hz: float, seed: int) -> np.ndarray:
    """[T, 3] a mode at 360 Hz that is struck so often, in noise."""
    rng = np.random.default_rng(seed)
    ring = np.exp(-2.0 * np.pi * 360.0 * 0.05 * TIME) * np.sin(2.0 * np.pi * 360.0 * TIME)
    blows = np.zeros(len(TIME))
    blows[np.unique((np.arange(0.1, SECONDS * at_hz) / at_hz * RATE_HZ).astype(int))] = 1.0
    wave = np.convolve(blows, ring)[: len(TIME)]
    return 10.0 * wave[:, None] * [0.3, 1.0, 0.6] + rng.normal(size=(len(TIME), 3))


def _found(left, plan=PLAN) -> OwnRate | None:
    """What is found where `left(speed, feed, seed)` [T, 3] is left of cuts at those of the plan."""
    trials = [
        SimpleNamespace(file=f"t{seed}.csv", feed_speed_m_s=feed) for seed, (_, feed) in enumerate(plan)
    ]
    nothing = np.zeros((len(TIME), 3))
    predicted = [
        Prediction(trial.file, TIME, TIME, left(*cut, seed), nothing, cut[0], np.zeros(3))
        for seed, (trial, cut) in enumerate(zip(trials, plan, strict=True))
    ]
    return own_rate(SimpleNamespace(trials=trials), predicted)


@pytest.mark.parametrize(
    ("per", "rate"), [("turn", 4.37), ("second", 47.3), ("metre", 3.1e4)], ids=["turn", "second", "metre"]
)
def test_what_the_rate_goes_with_is_told(per, rate):
    def left(speed, feed, seed):
        return _struck(rate * {"turn": speed, "second": 1.0, "metre": feed}[per], seed)

    found = _found(left)
    assert found is not None and list(found.rates) == [per]
    assert found.rates[per] == pytest.approx(rate, rel=0.01)
    assert np.count_nonzero(found.lowest_hz) >= 4 and found.multiples >= 3


def test_at_one_speed_nobody_knows_whether_it_turns_with_the_spindle():
    one_speed = [(12.0, feed) for _, feed in PLAN]
    assert _found(lambda speed, feed, seed: _struck(47.3, seed), one_speed) is None


def test_a_feed_that_goes_with_the_speed_leaves_both_open():
    as_fast = [(speed, 1e-4 * speed) for speed, _ in PLAN]
    found = _found(lambda speed, feed, seed: _struck(4.37 * speed, seed), as_fast)
    assert found is not None and list(found.rates) == ["turn", "metre"]
    assert found.rates["turn"] == pytest.approx(4.37, rel=0.01)
    assert "times a turn or every 0.0229 mm of the path" in str(found)


@pytest.mark.parametrize("error", [0.0, 0.008])
def test_what_comes_back_with_the_turns_has_no_rate_of_its_own(error):
    """The speed may be off by a per cent."""
    assert _found(lambda speed, feed, seed: _struck(3.0 * (1.0 + error) * speed, seed)) is None


def test_a_vibration_beside_the_turns_has_no_lowest_line():
    """Lines at 347.3 Hz and at as many turns beside it, as a lathe tool has that meets its own wave."""

    def left(speed, feed, seed):
        lines = 347.3 + speed * np.arange(-2, 3)
        wave = np.sum(np.cos(2.0 * np.pi * lines * TIME[:, None]) / (1.0 + np.abs(np.arange(-2, 3))), axis=1)
        return 3.0 * wave[:, None] + np.random.default_rng(seed).normal(size=(len(TIME), 3))

    assert _found(left) is None


@pytest.mark.parametrize("first", range(0, 60, 6))
def test_noise_has_none(first):
    def noise(speed, feed, seed):
        return np.random.default_rng(first + seed).normal(size=(len(TIME), 3))

    assert _found(noise) is None
