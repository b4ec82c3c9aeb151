"""A drill whose record is nearly all of its way in is judged where the others say that it is fully in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing.records.levels import as_levels
from mjx_cutting.tracing.records.way_in import levels_of
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

RATE_HZ, SECONDS, POINT_M, AIR_S = 500.0, 3.6, 1.8e-3, 0.3
FEEDS = (0.6e-3, 1.0e-3, 1.5e-3, 1.4e-3, 1.0e-3, 1.5e-3)


def _drilled(file: str, feed_m_s: float, seconds: float = SECONDS) -> Trial:
    """A hole in which the thrust grows with the depth of the point, and the torque with its square."""
    rng, time = (
        np.random.default_rng(len(file) + int(1e6 * feed_m_s)),
        np.arange(int(seconds * RATE_HZ)) / RATE_HZ,
    )
    share = np.clip((time - AIR_S) * feed_m_s / POINT_M, 0.0, 1.0)
    force = np.full((len(time), 3), np.nan)
    force[:, 2] = (600.0 + 4e5 * feed_m_s) * share + 10.0 * rng.normal(size=len(time))
    return Trial(
        file=file,
        kind="cut",
        milling=None,
        spindle_speed_rev_s=10.0,
        feed_speed_m_s=feed_m_s,
        radial_depth_m=3e-3,
        axial_width_m=3e-3,
        time_s=time,
        force_n=force,
        torque_nm=(0.8 + 500.0 * feed_m_s) * share**2 + 0.02 * rng.normal(size=len(time)),
    )


def _session(*trials: Trial) -> Dataset:
    tool, sensor = ToolInfo("drill", 2, 6e-3), Sensor(RATE_HZ, (10.0, 0.02))
    return Dataset(name="holes", tool=tool, sensor=sensor, trials=trials)


def _holes() -> list[Trial]:
    return [_drilled(f"t{index}.csv", feed) for index, feed in enumerate(FEEDS)]


def test_a_ramp_that_fills_the_record_ends_where_the_others_do():
    levels = as_levels(_session(*_holes()))
    assert [trial.file for trial in levels.trials] == [f"t{index}.csv" for index in range(len(FEEDS))]
    slow = levels.trials[0]
    fully_in = AIR_S + POINT_M / FEEDS[0]
    assert fully_in - 0.02 < slow.time_s[0] < fully_in + 0.2
    np.testing.assert_allclose(slow.force_n[:, 1:].mean(axis=0), [1.1, 840.0], rtol=0.02)


def test_of_a_sheet_that_is_uneven_the_level_begins_where_the_others_bend_into_theirs():
    """A periodic one, of which no record shows an even level."""

    def uneven(trial: Trial) -> Trial:
        depth_m = np.maximum(trial.time_s - AIR_S, 0.0) * trial.feed_speed_m_s
        swing = 1.0 + 0.13 * np.sin(2.0 * np.pi * depth_m / 1.3e-3)
        return replace(trial, force_n=swing[:, None] * trial.force_n, torque_nm=swing * trial.torque_nm)

    levels = as_levels(_session(*(uneven(each) for each in _holes())))
    for trial, feed in zip(levels.trials, FEEDS, strict=True):
        assert trial.time_s[0] > AIR_S + 0.85 * POINT_M / feed


def test_a_record_that_ends_on_its_ramp_is_left_out_by_name():
    short = _drilled("short.csv", FEEDS[0], seconds=3.0)
    levels = as_levels(_session(short, *_holes()[1:]))
    assert [each.file for each in levels.left_out] == ["short.csv"]
    assert "record for longer" in levels.left_out[0].reason
    assert "short.csv" not in {trial.file for trial in levels.trials}


@pytest.mark.parametrize("known", [0, 2])
def test_without_enough_others_every_record_is_read_by_itself(known):
    holes = [_drilled(f"s{index}.csv", FEEDS[0]) for index in range(3)] + _holes()[1 : 1 + known]
    holes = [replace(each, force_n=np.stack([each.torque_nm] * 3, axis=1)) for each in holes]
    assert levels_of(holes) == {each.file: levels_of([each])[each.file] for each in holes}
