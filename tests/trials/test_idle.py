"""A cut in which the tool never cut is named; a light one is not."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.trials.checks import sift
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial
from mjx_cutting.trials.idle import idle_cuts

TIME_S = np.arange(2000) / 500.0


def _cut(file: str, mean_n: float, line_n: float = 0.0, depth_m: float = 1e-3, kind="cut") -> Trial:
    noise = np.random.default_rng(len(file)).normal(0.0, 1.0, (len(TIME_S), 3))
    line = line_n * np.cos(2 * np.pi * 40.0 * TIME_S)[:, None]
    return Trial(
        file=file,
        kind=kind,
        milling="conventional",
        spindle_speed_rev_s=10.0,
        feed_speed_m_s=0.01,
        radial_depth_m=depth_m,
        axial_width_m=1e-3,
        time_s=TIME_S,
        force_n=np.array([-0.8, -0.6, 0.0]) * mean_n + line + noise,
    )


WHOLE = [_cut("a.csv", 40.0, 5.0), _cut("bb.csv", 50.0, 5.0), _cut("ccc.csv", 30.0, 5.0)]


def test_a_record_of_bias_and_noise_is_left_out_with_its_reason():
    made = Dataset(
        name="s",
        tool=ToolInfo("slitting_saw", 20, 0.05),
        sensor=Sensor(500.0),
        trials=(*WHOLE, _cut("dddd.csv", 2.0)),
    )
    found = sift(made)
    assert [each.file for each in found.trials] == ["a.csv", "bb.csv", "ccc.csv"]
    (left,) = found.left_out
    assert left.file == "dddd.csv" and "the tool does not cut" in left.reason and "35 N" in left.reason


@pytest.mark.parametrize(
    "light",
    [
        _cut("dddd.csv", 2.0, line_n=1.0),  # its teeth show
        _cut("dddd.csv", 8.0),  # its mean does
        _cut("dddd.csv", 2.0, depth_m=5e-5),  # so little is cut
        _cut("dddd.csv", 0.0, kind="air"),
    ],
)
def test_a_light_cut_stays(light):
    assert idle_cuts([*WHOLE, light]) == {}


def test_two_trials_say_nothing_of_each_other():
    assert idle_cuts([WHOLE[0], _cut("dddd.csv", 0.0)]) == {}


@pytest.mark.parametrize(("zeroed", "left"), [("session", ["dddd.csv"]), ("trial", [])])
def test_air_says_where_the_zero_of_a_sensor_is_that_was_zeroed_once(zeroed, left):
    """Of one zeroed before each trial it says nothing."""
    air = _cut("eeeee.csv", 21.0, kind="air")
    made = Dataset(
        name="s",
        tool=ToolInfo("slitting_saw", 20, 0.05),
        sensor=Sensor(500.0, zeroed=zeroed),
        trials=(*WHOLE, _cut("dddd.csv", 20.0), air),
    )
    assert [each.file for each in sift(made).left_out] == left
