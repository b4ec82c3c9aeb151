"""A level that goes with the spindle's speed is not called a drift, however the speeds follow one another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing import trace
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo
from mjx_cutting.trials.synthetic import Conditions, Sheet, make_trials

SPEEDS = (20.0, 35.0, 50.0)
SHEET = Sheet((8e8, 2.4e8, 1.2e8), (2e4, 1.6e4, 4e3))


def _in_order_of_speed(level) -> Dataset:
    """Two trials in the cut and one in air at each speed, a minute apart; on y and z stands `level(speed,
    clock)`, N."""
    cuts = [Conditions(f, f * 2 * chip, 0.012, 0.002) for f in SPEEDS for chip in (4e-5, 9e-5, 6e-5)]
    sensor = Sensor(2500.0, (0.5, 0.5, 0.5), zeroed="session")
    made = make_trials(ToolInfo("end_mill", 2, 0.012), SHEET, cuts, sensor, duration_s=0.6)
    generator, trials = np.random.default_rng(4), []
    for index, trial in enumerate(made.trials):
        clock_s, in_air = 60.0 * (index + 1), index % 3 == 2
        force = trial.force_n
        if in_air:
            force = made.trials[index].force_n * 0.0 + generator.normal(0.0, 0.5, trial.force_n.shape)
        more = level(trial.spindle_speed_rev_s, clock_s + trial.time_s)
        force = force + np.stack([0 * trial.time_s, 0.5 * more, more], axis=1)
        kind = "air" if in_air else "cut"
        trials.append(replace(trial, kind=kind, force_n=force, clock_start_s=clock_s))
    return replace(made, trials=tuple(trials))


@pytest.mark.parametrize(
    ("level", "named"),
    [
        (lambda speed, clock: 12.0 * (speed / 50.0) ** 2 + 0.0 * clock, []),
        (lambda speed, clock: 12.0 * -np.expm1(-clock / 400.0), ["thermal_drift"]),
    ],
    ids=["with the speed", "with the clock"],
)
def test_a_level_is_called_a_drift_only_where_it_goes_with_the_clock(level, named):
    found = trace(_in_order_of_speed(level), effects=("thermal_drift",))
    assert [each["name"] for each in found.verdict["effects"]] == named
    if not named:
        assert found.verdict["verdict"] == "unexplained"
        tried = found.search.rounds[0].candidates[0].decision
        assert any("follows the spindle's speed" in why for why in tried.reasons)
