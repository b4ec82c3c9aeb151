"""Samples that a logger filled in are found and bridged; a record that repeats itself by nature is let be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.trials.checks import check_trial
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial
from mjx_cutting.trials.dropouts import find_dropouts, without_dropouts

RATE_HZ, SAMPLES = 2000.0, 4000
TOOL, SENSOR = ToolInfo("end_mill", 2, 0.01), Sensor(RATE_HZ)


def _record(noise: float = 1.0, quantum: float = 0.0) -> Trial:
    time = np.arange(SAMPLES) / RATE_HZ
    wave = np.sin(2.0 * np.pi * 40.0 * time)[:, None] * [30.0, 20.0, -10.0]
    force = 50.0 + wave + noise * np.random.default_rng(0).normal(size=(SAMPLES, 3))
    return Trial(
        file="t1.csv", kind="cut", milling="slot", spindle_speed_rev_s=20.0, feed_speed_m_s=0.01,
        radial_depth_m=0.01, axial_width_m=1e-3, time_s=time,
        force_n=np.round(force / quantum) * quantum if quantum else force,
    )  # fmt: skip


def _filled(trial: Trial, first: int, last: int, value: np.ndarray | float) -> Trial:
    force = trial.force_n.copy()
    force[first : last + 1] = value
    return replace(trial, force_n=force)


@pytest.mark.parametrize("held", [True, False], ids=["held", "zeros"])
def test_lost_samples_are_bridged_and_told(held):
    sound = _record()
    spoiled = _filled(sound, 1513, 1521, sound.force_n[1512] if held else 0.0)
    np.testing.assert_array_equal(find_dropouts(spoiled), np.arange(1513, 1522))
    made = Dataset(name="one", tool=TOOL, sensor=SENSOR, trials=(spoiled,))
    mended, (said,) = without_dropouts(made)
    assert said.startswith("t1.csv: 9 samples that repeat") and "the first at 0.7565 s" in said
    expected = sound.force_n.copy()
    for axis in range(3):
        line = np.interp(np.arange(1513, 1522), [1512, 1522], expected[[1512, 1522], axis])
        expected[1513:1522, axis] = line
    np.testing.assert_allclose(mended.trials[0].force_n, expected, rtol=1e-12)
    (warning,) = [each for each in check_trial(spoiled, TOOL, SENSOR).warnings if "repeat the one" in each]
    assert warning.startswith("got 9 samples")


def test_two_places_are_both_found():
    spoiled = _filled(_filled(_record(), 100, 104, 0.0), 3000, 3010, 0.0)
    np.testing.assert_array_equal(find_dropouts(spoiled), [*range(100, 105), *range(3000, 3011)])


@pytest.mark.parametrize(
    "trial",
    [
        _record(),
        _record(noise=0.1, quantum=10.0),
        _filled(_record(noise=0.0), 1000, 1800, 0.0),
        _filled(_record(), 1000, 1100, 0.0),
        _filled(_record(), 0, 10, 0.0),
        _filled(_record(), 3990, 3999, 0.0),
    ],
    ids=["sound", "coarse", "out of the cut", "too many", "at the start", "at the end"],
)
def test_what_is_no_drop_out_is_let_be(trial):
    assert len(find_dropouts(trial)) == 0
    made = Dataset(name="one", tool=TOOL, sensor=SENSOR, trials=(trial,))
    assert without_dropouts(made)[0] is made


def test_one_channel_that_repeats_itself_lost_nothing():
    trial = _record()
    force = trial.force_n.copy()
    force[500:520, 1] = 0.0
    assert len(find_dropouts(replace(trial, force_n=force))) == 0
