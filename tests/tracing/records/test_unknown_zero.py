"""Of drills whose sensor is off its zero, only records that show the air tell their force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing import trace
from mjx_cutting.tracing.records.levels import as_levels
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

RATE_HZ = 250.0
FEEDS = (8e-5, 1.2e-4, 2e-4, 8e-5, 1.2e-4, 2e-4, 3e-4, 3e-4)


def _holes(off_n: float, begin_in_air: int) -> Dataset:
    """Eight holes; the sensor is off its zero by `off_n` or so; so many records begin before the cut."""
    generator, time, trials = np.random.default_rng(4), np.arange(500) / RATE_HZ, []
    radius = 3e-3
    for index, feed in enumerate(FEEDS):
        thrust = radius * (1.5e9 * feed + 2 * 4e4)
        torque = radius**2 / 2.0 * (2.5e9 * feed + 2 * 3e4)
        inside = (time > 0.5) | (index >= begin_in_air)
        bias = generator.normal(0.0, off_n)
        force = np.full((500, 3), np.nan)
        force[:, 2] = thrust * inside + bias + generator.normal(0.0, 3.0, 500)
        trials.append(
            Trial(
                file=f"{index}.csv", kind="cut", milling=None, spindle_speed_rev_s=20.0,
                feed_speed_m_s=20.0 * feed, radial_depth_m=radius, axial_width_m=radius, time_s=time,
                force_n=force, torque_nm=torque * inside + generator.normal(0.0, 0.01, 500),
            )
        )  # fmt: skip
    return Dataset(
        name="holes", source="made by calculation", licence="Apache-2.0",
        tool=ToolInfo("drill", 2, 2 * radius), sensor=Sensor(RATE_HZ, zeroed="trial"), trials=tuple(trials),
    )  # fmt: skip


def test_records_without_air_are_left_out_by_name_and_nothing_is_missing():
    found = trace(_holes(60.0, 5), effects=())
    assert [each["file"] for each in found.verdict["left_out"]] == ["5.csv", "6.csv", "7.csv"]
    assert all("begin the record" in each["reason"] for each in found.verdict["left_out"])
    assert found.verdict["verdict"] == "nothing missing"


@pytest.mark.parametrize(("off_n", "begin_in_air"), [(0.0, 5), (2.0, 5), (60.0, 3), (60.0, 0), (60.0, 8)])
def test_all_stay_where_the_zero_is_nearly_right_or_few_records_show_it_or_all_do(off_n, begin_in_air):
    made = _holes(off_n, begin_in_air)
    found = as_levels(made)
    assert found.left_out == () and len(found.trials) == len(made.trials)


def test_a_session_zeroed_once_keeps_all():
    made = _holes(60.0, 5)
    found = as_levels(replace(made, sensor=replace(made.sensor, zeroed="session")))
    assert found.left_out == ()
