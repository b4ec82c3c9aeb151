"""Chatter of a tool that is always engaged is named; what only looks like it is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing.along.turning_chatter import find_chatter
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

RATE_HZ, SECONDS, NOISE_N = 1000.0, 3.0, 3.0
CUTS = [(speed, width) for speed in (9.3, 11.0) for width in (5e-4, 9e-4, 9e-4)]
WIDE = 9e-4
TIME = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
WAY = np.array([0.35, 1.0, 0.25])


def _chatter(speed: float, width: float, index: int) -> np.ndarray:
    """[T] a limit cycle above 142 Hz that the speed moves, with the tool out of the chip once a turn."""
    if width < WIDE:
        return np.zeros_like(TIME)
    own = 2.0 * np.pi * (142.0 + 0.6 * speed) * TIME + index
    grown = 40.0 * (1.0 - np.exp(-TIME / 1.5))
    return grown * np.cos(own) * (1.0 + 0.3 * np.cos(2.0 * np.pi * speed * TIME))


def _find(left, air=None, cuts=CUTS):
    """What is found where levels leave `left(speed, width, index)` [T] along one way, and noise."""
    trials, after, error, energy = [], [], [], []
    for index, (speed, width) in enumerate(cuts):
        noise = NOISE_N * np.random.default_rng(index).normal(size=(len(TIME), 3))
        level = 2e5 * width * np.array([-0.9, 1.9, -0.5])
        measured = level + np.outer(left(speed, width, index), WAY) + noise
        trials.append(
            Trial(
                file=f"t{index}.csv", kind="cut", milling=None, spindle_speed_rev_s=speed,
                feed_speed_m_s=1e-4 * speed, radial_depth_m=width, axial_width_m=width, time_s=TIME,
                force_n=measured,
            )
        )  # fmt: skip
        predicted = np.tile(measured.mean(axis=0), (len(TIME), 1))
        after.append(Prediction(trials[-1].file, TIME, TIME, measured, predicted, speed, np.zeros(3)))
        error.append(np.sum((measured - predicted) ** 2, axis=0))
        energy.append(np.sum(measured**2, axis=0))
    if air is not None:
        idle = np.outer(air, WAY) + NOISE_N * np.random.default_rng(99).normal(size=(len(TIME), 3))
        trials.append(replace(trials[0], file="air.csv", kind="air", force_n=idle))
    dataset = Dataset(
        name="t", tool=ToolInfo("turning", 1, 0.04), sensor=Sensor(RATE_HZ), trials=tuple(trials)
    )
    before = HeldOut(np.stack(error), np.stack(energy), None, np.arange(len(cuts)))
    return find_chatter(dataset, (0.0, 0.5 * RATE_HZ), after, before)


def _why(found) -> str:
    assert found is not None and found.round.accepted is None
    return " ".join(found.round.candidates[0].decision.reasons)


def test_it_is_named_where_wide_cuts_vibrate_and_narrow_ones_do_not():
    found = _find(_chatter, air=np.zeros_like(TIME))
    assert found is not None and found.round.accepted is not None
    told = found.round.accepted.decision.parameters["frequency_hz"]
    assert told.low < 142.0 < told.high == pytest.approx(142.0 + 0.6 * 11.0, abs=0.5)
    before, after = found.round.before, found.round.accepted.heldout
    assert after.nrmse < 0.5 * before.nrmse
    assert after.only(np.array([w < WIDE for _, w in CUTS])).nrmse == pytest.approx(
        before.only(np.array([w < WIDE for _, w in CUTS])).nrmse
    )
    assert "4 of 6" in found.evidence[0] and "0.5 mm wide" in found.evidence[1]


def test_levels_that_hold_noise_alone_show_nothing():
    assert _find(lambda speed, width, index: np.zeros_like(TIME)) is None


def test_lines_at_two_frequencies_far_apart_are_no_chatter():
    """Two trials at each, and none in between."""

    def at_two(speed, width, index):
        return (width == WIDE) * 30.0 * np.cos(2.0 * np.pi * (150.3 if speed < 10.0 else 220.7) * TIME)

    assert _find(at_two) is None


def test_mains_stay_at_one_frequency_in_every_cut():
    why = _why(_find(lambda speed, width, index: 30.0 * np.cos(2.0 * np.pi * 150.0 * TIME + index)))
    assert "stays whatever the speed" in why


def test_a_gear_goes_with_the_speed():
    why = _why(_find(lambda speed, width, index: 30.0 * np.cos(2.0 * np.pi * 13.4 * speed * TIME + index)))
    assert "in proportion" in why


def test_a_line_at_a_multiple_of_the_spindle_is_forced():
    def lobed(speed, width, index):
        return (width >= WIDE) * 30.0 * np.cos(2.0 * np.pi * 14.0 * speed * TIME + index)

    assert "multiples of the spindle" in _why(_find(lobed))


def test_a_mode_that_a_bearing_strikes_in_wide_cuts_is_driven():
    """A defect that comes by 4.37 times a turn shows at all multiples of that, most near the mode."""

    def struck(speed, width, index):
        lines = 4.37 * speed * np.arange(1, 9)
        size = 4.0 + 40.0 * np.exp(-(((lines - 150.0) / 25.0) ** 2))
        wave = np.cos(2.0 * np.pi * lines * TIME[:, None] + index * np.arange(8)) @ size
        return (width >= WIDE) * wave

    assert "multiples of one that comes back 4.366 times a turn" in _why(_find(struck))


def test_a_line_that_is_in_air_too_is_not_of_the_cut():
    assert "in air too" in _why(_find(_chatter, air=20.0 * np.cos(2.0 * np.pi * 148.0 * TIME)))


def test_two_cuts_that_vibrate_are_too_few():
    assert _find(lambda speed, width, index: _chatter(speed, width, index) * (index in (1, 2))) is None
