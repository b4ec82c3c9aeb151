"""Tooth passing that folds to one place at two speeds: the base model tells which the spindle had."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.tracing.fitting.believed_speeds import lines_as_it_turned
from mjx_cutting.tracing.fitting.mirrored_speeds import from_the_right_side
from mjx_cutting.tracing.records.lines import compress
from mjx_cutting.tracing.records.spindle import mirror_speed
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo
from mjx_cutting.trials.synthetic import Conditions, Sheet, make_trials

TEETH, RATE_HZ = 24, 500.0
TRUE_REV_S = np.array([20.95, 20.7, 18.3, 14.0, 20.9, 17.2])


@pytest.fixture(scope="module")
def folded() -> Dataset:
    """A saw at 500 Hz without a filter; tooth passing at 20.833 rev/s is half a thousand hertz."""
    tool, sheet = ToolInfo("slitting_saw", TEETH, 0.05), Sheet((6e7, 2e7, 0.0), (1e3, 4e2, 0.0))
    chips = (2e-5, 6e-5, 4e-5, 3e-5, 6e-5, 2e-5)
    cuts = [
        Conditions(speed, speed * TEETH * chip, 3e-3, 0.0016, "conventional")
        for speed, chip in zip(TRUE_REV_S, chips, strict=True)
    ]
    sensor = Sensor(RATE_HZ, (0.02, 0.02, 0.02))
    return make_trials(tool, sheet, cuts, sensor, duration_s=3.0, seed=4, speed_error=0.0)


def test_the_mirror_of_a_mirror_is_the_speed_itself():
    mirror = mirror_speed(20.95, TEETH, RATE_HZ)
    assert mirror == pytest.approx(2.0 * 500.0 / TEETH - 20.95)
    assert mirror_speed(mirror, TEETH, RATE_HZ) == pytest.approx(20.95)


@pytest.mark.parametrize("stated", [20.95, 20.75])
def test_the_speed_is_found_on_whatever_side_the_stated_one_lies(folded, stated):
    """What is stated of the first lies once on this side of the fold and once on that."""
    first, *rest = folded.trials
    dataset = replace(folded, trials=(replace(first, spindle_speed_rev_s=stated), *rest))
    with _platform.x64():
        lines = lines_as_it_turned(dataset, (0.0, 250.0))
    np.testing.assert_allclose(lines.speed_rev_s, TRUE_REV_S, atol=2e-3)


def test_trials_at_the_wrong_side_are_turned(folded):
    about = TRUE_REV_S.copy()
    about[[0, 4]] = [mirror_speed(each, TEETH, RATE_HZ) for each in about[[0, 4]]]
    with _platform.x64():
        wrong = compress(folded, (0.0, 250.0), about_rev_s=about)
        found = from_the_right_side(folded, wrong)
    assert np.all(np.abs(wrong.speed_rev_s - TRUE_REV_S)[[0, 4]] > 0.1)
    np.testing.assert_allclose(found.speed_rev_s, TRUE_REV_S, atol=2e-3)
