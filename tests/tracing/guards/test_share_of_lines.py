"""An effect that is a little like what makes the teeth unlike is not named for it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting.cutting.effects import RadialRunout
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.guards import share_of_lines
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


@pytest.mark.slow
def test_a_dull_sector_is_not_called_runout():
    verdict = trace(_with_a_dull_sector(_cut()), effects=("radial_runout",)).verdict
    assert verdict["effects"] == [] and verdict["verdict"] == "unexplained"


@pytest.mark.slow
def test_runout_is():
    verdict = trace(_cut(Hidden(runout_m=6e-6)), effects=("radial_runout",)).verdict
    assert [each["name"] for each in verdict["effects"]] == [RadialRunout.name]


@pytest.mark.parametrize(
    ("once_a_turn", "at_passing", "told"),
    [(0.6, 0.1, None), (0.35, 0.2, "explains 35%"), (0.6, -0.2, "explains 40%")],
    ids=["takes its part", "takes its part at tooth passing", "gives back at tooth passing"],
)
def test_what_makes_teeth_unlike_takes_half_of_what_repeats_once_a_turn(
    monkeypatch, once_a_turn: float, at_passing: float, told: str | None
):
    """Of a squared residual of one once a turn, and one at tooth passing, it takes these."""
    order = np.concatenate([[0], np.repeat(np.arange(1, 9), 2)])
    problem = SimpleNamespace(order=order, tool=SimpleNamespace(kind="slitting_saw", teeth=4))
    passing = order % 4 == 0
    before = np.where(passing, 1.0 / passing.sum(), 1.0 / (~passing).sum())
    after = before * np.where(passing, 1.0 - at_passing, 1.0 - once_a_turn)
    left = {(): before[None, :, None], ("runout",): after[None, :, None]}
    monkeypatch.setattr(share_of_lines, "squares", lambda problem, effects, x: left[effects])
    monkeypatch.setattr(share_of_lines, "noise_squares", lambda problem, lines: np.zeros((1, 17, 1)))
    fit = SimpleNamespace(x=None)
    gain = SimpleNamespace(problem=problem, lines=None, others=(), effects=("runout",), before=fit, found=fit)
    why = share_of_lines.rather_unlike(gain)
    assert why is None if told is None else why is not None and why.startswith(told)


@pytest.mark.slow
def test_what_takes_a_third_of_tooth_passing_and_leaves_the_rest_is_not_named():
    """A sensor with hysteresis bends the force under a tooth a little as a compliant arm does."""
    found = trace(make("mill", {"hysteresis": "medium"}, 403).dataset, effects=("static_compliance",))
    assert found.verdict["effects"] == []
    assert "tooth passing and leaves the rest" in found.search.rounds[0].candidates[0].decision.reasons[0]
