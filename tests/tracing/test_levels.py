"""Drills and turning tools are traced by their levels."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.tracing import trace
from mjx_cutting.tracing.levels import as_levels
from mjx_cutting.trials import resolve
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

RATE_HZ = 250.0


def _drills(wear: float, seed: int = 0) -> Dataset:
    """Three drills of eight holes at three feeds; edge forces grow by `wear` of themselves a metre."""
    generator, trials = np.random.default_rng(seed), []
    radius, teeth = 3e-3, 2
    for drill in "abc":
        for hole in range(8):
            feed = (1e-4, 2e-4, 4e-4)[hole % 3]
            length = 0.01 * hole
            edge = 1.0 + wear * length
            thrust = teeth * radius * (1.5e9 * feed / teeth + 6e4 * edge)
            torque = teeth * radius * (2.5e9 * feed / teeth + 4e4 * edge) * radius / 2.0
            time = np.arange(500) / RATE_HZ
            inside = (time > 0.3) & (time < 1.8)
            force = np.full((500, 3), np.nan)
            force[:, 2] = thrust * inside + generator.normal(0.0, 2.0, 500)
            trials.append(
                Trial(
                    file=f"{drill}{hole}.csv",
                    kind="cut",
                    milling=None,
                    spindle_speed_rev_s=13.0,
                    feed_speed_m_s=13.0 * feed,
                    radial_depth_m=radius,
                    axial_width_m=radius,
                    tool_id=drill,
                    cut_length_before_m=length,
                    time_s=time,
                    force_n=force,
                    torque_nm=torque * inside + generator.normal(0.0, 0.005, 500),
                )
            )
    return Dataset(
        name="drills",
        source="made by calculation",
        licence="Apache-2.0",
        tool=ToolInfo("drill", teeth, 2 * radius),
        sensor=Sensor(RATE_HZ),
        trials=tuple(trials),
    )


def test_only_the_steady_part_is_kept():
    before, after = _drills(0.0), as_levels(_drills(0.0))
    assert len(after.trials) == len(before.trials)
    for trial in after.trials:
        assert 0.3 < trial.time_s[0] < 0.6 and 1.5 < trial.time_s[-1] < 1.8
        assert np.all(trial.force_n[:, 0] == 0.0) and np.all(trial.force_n[:, 1:] > 0.0)


def test_wear_of_drills_is_named_on_drills_held_out():
    verdict = trace(_drills(20.0), effects=("flank_wear", "size_effect", "ploughing")).verdict
    assert [each["name"] for each in verdict["effects"]] == ["flank_wear"]
    assert verdict["after"]["heldout_nrmse"] < 0.5 * verdict["before"]["heldout_nrmse"]


def test_sharp_drills_are_left_alone():
    verdict = trace(_drills(0.0), effects=("flank_wear", "size_effect", "ploughing")).verdict
    assert verdict["effects"] == [] and verdict["verdict"] == "nothing missing"


@pytest.mark.slow
@pytest.mark.measured
def test_measured_drills_wear(measured_data):
    verdict = trace(resolve("drilling")).verdict
    assert [each["name"] for each in verdict["effects"]] == ["flank_wear"]
    assert verdict["after"]["heldout_nrmse"] < verdict["before"]["heldout_nrmse"]
    assert ["d14h45" in each["file"] for each in verdict["left_out"]] == [True]
    assert any(each["name"] == "radial_runout" for each in verdict["not_testable"])
