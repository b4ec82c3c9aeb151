"""An effect that is a little like what makes the teeth unlike is not named for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting.cutting.effects import RadialRunout
from mjx_cutting.tracing import trace
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo
from mjx_cutting.trials.synthetic import Conditions, Hidden, Sheet, make_trials

CUTS = [
    Conditions(speed, speed * 8 * chip, 0.02, 0.002) for speed in (20.0, 23.0) for chip in (2e-5, 4e-5, 8e-5)
]


def _cut(hidden: Hidden | None = None) -> Dataset:
    tool, sheet = ToolInfo("end_mill", 8, 0.02), Sheet((8e8, 2.4e8, 1.2e8), (2e4, 1.6e4, 4e3))
    return make_trials(tool, sheet, CUTS, Sensor(2000.0, (0.5, 0.5, 1.0)), hidden=hidden, duration_s=1.0)


def _with_a_dull_sector(dataset: Dataset) -> Dataset:
    """Two teeth beside each other rub more, as strongly at every feed, at a phase of each trial's own."""
    generator, trials = np.random.default_rng(2), []
    for trial in dataset.trials:
        angle = 2 * np.pi * trial.spindle_speed_rev_s * trial.time_s + generator.uniform(0.0, 6.28)
        more = sum(np.clip(np.sin(angle - 2 * np.pi * j / 8), 0.0, None) ** 3 for j in (0, 1))
        trials.append(replace(trial, force_n=trial.force_n + more[:, None] * np.array([6.0, -25.0, 14.0])))
    return replace(dataset, trials=tuple(trials))


def test_a_dull_sector_is_not_called_runout():
    verdict = trace(_with_a_dull_sector(_cut()), effects=("radial_runout",)).verdict
    assert verdict["effects"] == [] and verdict["verdict"] == "unexplained"


def test_runout_is():
    verdict = trace(_cut(Hidden(runout_m=6e-6)), effects=("radial_runout",)).verdict
    assert [each["name"] for each in verdict["effects"]] == [RadialRunout.name]


@pytest.mark.slow
def test_what_takes_a_third_of_tooth_passing_and_leaves_the_rest_is_not_named():
    """A sensor with hysteresis bends the force under a tooth a little as a compliant arm does."""
    found = trace(make("mill", {"hysteresis": "medium"}, 403).dataset, effects=("static_compliance",))
    assert found.verdict["effects"] == []
    assert "tooth passing and leaves the rest" in found.search.rounds[0].candidates[0].decision.reasons[0]
