"""A line of the mains stays where it is, whatever the spindle does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing.along.slow import search_slow
from mjx_cutting.tracing.along.slow_kinds import KINDS
from mjx_cutting.tracing.along.surety import reach_of_the_model
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.records.course import Course

RATE_HZ, SECONDS, NOISE_N = 500.0, 4.0, 0.1
FEEDS = (0.008, 0.010, 0.0125, 0.015, 0.018, 0.02)
HUM = np.array([0.3, 0.2, 0.25])


def _humming(speeds_rev_s, lag=(0.0, 1.0, -2.0)):
    """The first round on six cuts, at speeds of the spindle, that all hold a line of 50.02 Hz."""
    time, made = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ, []
    for index, (feed, speed) in enumerate(zip(FEEDS, speeds_rev_s, strict=True)):
        teeth = np.cos(2 * np.pi * 80.0 * time + index)[:, None]
        chip = (1.0 + 0.5 * teeth) * np.array([3.0, 5.0, 1.0])
        noise = NOISE_N * np.random.default_rng(index).normal(size=chip.shape)
        left = HUM * np.cos(2 * np.pi * 50.02 * time[:, None] + 1.7 * index + np.asarray(lag)) + noise
        angle = 2 * np.pi * speed * time
        made.append(
            Course(time, feed * time, None, chip, np.full_like(chip, 2.0), left, RATE_HZ, (0.0, 200.0))
        )
        made[-1] = replace(made[-1], angle_rad=angle)
    error = np.stack([np.sum(each.left_n**2, axis=0) for each in made])
    before = HeldOut(error, 20.0 * error, None, np.arange(len(FEEDS)))
    # a model of the cut may be wrong by much without putting a line there
    return search_slow(tuple(made), before, np.full(3, 1.0 / NOISE_N), tolerance=0.5)[0]


def test_mains_is_named_whatever_phase_each_trial_starts_at():
    lag = (0.0, 1.0, -2.0)
    found = _humming([17.0, 17.0, 18.0, 18.0, 19.0, 19.0], lag).accepted
    assert found is not None and found.kind.name == "mains_pickup"
    values = found.effect.values()
    np.testing.assert_allclose(values["amplitude_n"], HUM, atol=0.01)
    np.testing.assert_allclose(np.diff(values["phase_rad"]), np.diff(lag), atol=0.1)
    assert values["frequency_hz"] == pytest.approx(50.02, abs=0.02)


@pytest.mark.parametrize(
    ("others_rev_s", "named"),
    [
        (4 * [25.0], False),
        (4 * [26.0], True),
        ([25.0, 26.0, 26.0, 26.0], True),
        ([25.0, 25.0, 26.0, 27.0], True),
        ([25.0, 25.0, 25.0, 26.0], False),
    ],
)
def test_what_stands_at_a_multiple_of_the_spindle_is_not_laid_to_the_mains(others_rev_s, named):
    """Unless it stays there, as large, while some of the trials turn at another speed."""
    found = _humming([25.0, 25.0, *others_rev_s])
    assert (found.accepted is not None) == named
    if not named:
        mains = next(each for each in found.candidates if each.kind.name == "mains_pickup")
        there = 2 + others_rev_s.count(25.0)
        assert f"Hz is a multiple of the spindle's frequency in {there} of 6" in mains.decision.reasons[0]


@pytest.mark.parametrize(("lines_hz", "reach"), [((50.0,), 1.0), ((25.0, 50.0), 0.5**0.5), ((80.0,), 0.0)])
def test_a_model_may_be_wrong_at_the_mains_only_where_its_own_force_has_a_line_there(lines_hz, reach):
    time, zero = np.arange(1000) / RATE_HZ, np.zeros((1000, 3))
    wave = np.cos(2 * np.pi * np.outer(time, lines_hz)).sum(axis=1)[:, None] * np.array([1.0, -2.0, 0.5])
    course = Course(time, 0.01 * time, None, wave, zero, zero, RATE_HZ, (0.0, 200.0))
    (mains,) = (each for each in KINDS if each.name == "mains_pickup")
    found = reach_of_the_model(mains, [course], np.array([50.0]))
    assert found == pytest.approx(reach, abs=0.02)
