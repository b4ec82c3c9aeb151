"""A spindle whose measured speed changes within a record: its lines are those of the angle it turned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from mjx_cutting.tracing import trace
from mjx_cutting.tracing.records.even_time import even_time
from mjx_cutting.tracing.records.spindle import as_turned, spindle_angle, spindle_speed
from mjx_cutting.trials.dataset import Dataset, Trial
from mjx_cutting.trials.synthetic import Hidden

NOISE_REV_S = 0.01
FASTER = 0.12


def _ramping(trial: Trial, seed: int = 0) -> tuple[Trial, np.ndarray]:
    """The trial as cut while the spindle speeds up, the feed with it; and the angle in turns [T]."""
    share = np.linspace(0.0, 1.0, len(trial.time_s))
    speed = trial.spindle_speed_rev_s * (1.0 + FASTER * (share - 0.5))
    turns = np.cumsum(speed) * (trial.time_s[1] - trial.time_s[0])
    turns -= turns[0]
    even = turns / turns[-1] * (trial.time_s[-1] - trial.time_s[0])
    force = CubicSpline(trial.time_s - trial.time_s[0], trial.force_n)(even)
    measured = speed + NOISE_REV_S * np.random.default_rng(seed).standard_normal(len(speed))
    return replace(trial, force_n=force, spindle_speed_measured_rev_s=measured), turns


def _unmeasured(dataset: Dataset) -> Dataset:
    trials = [replace(each, spindle_speed_measured_rev_s=None) for each in dataset.trials]
    return replace(dataset, trials=tuple(trials))


@pytest.fixture(scope="module")
def ramping(mill) -> Dataset:
    """Six slots of a tool that runs out, the spindle speeding up in two of them."""
    dataset = mill(Hidden(runout_m=1.2e-5, runout_angle_rad=0.7))
    trials = [_ramping(each)[0] if index in (1, 4) else each for index, each in enumerate(dataset.trials)]
    return replace(dataset, trials=tuple(trials))


def test_the_angle_is_what_the_speed_integrates_to(mill):
    trial, turns = _ramping(mill().trials[1])
    speed = turns[-1] / (trial.time_s[-1] - trial.time_s[0])
    assert spindle_angle(trial, speed) == pytest.approx(2.0 * np.pi * turns, abs=0.02)
    even = even_time(trial)
    assert even is not None
    assert np.abs(even - (trial.time_s - trial.time_s[0])).max() * speed > 0.3


@pytest.mark.parametrize("what", ["noise", "steps", "constant"])
def test_a_speed_that_is_not_seen_to_change_leaves_the_angle_alone(mill, what: str):
    trial, rng = mill().trials[1], np.random.default_rng(1)
    noisy = trial.spindle_speed_rev_s + NOISE_REV_S * rng.standard_normal(len(trial.time_s))
    slow = trial.spindle_speed_rev_s + 0.4 * np.sin(np.linspace(0.0, 3.0, len(noisy)))
    column = {"noise": noisy, "steps": np.round(slow), "constant": np.full_like(noisy, 40.0)}[what]
    stated = replace(trial, spindle_speed_measured_rev_s=column)
    assert even_time(stated) is None
    even = 2.0 * np.pi * 40.0 * (trial.time_s - trial.time_s[0])
    assert np.array_equal(spindle_angle(stated, 40.0), even)


def test_its_mean_speed_is_found_along_the_angle(ramping, mill):
    for trial, even in zip(
        ramping.trials, mill(Hidden(runout_m=1.2e-5, runout_angle_rad=0.7)).trials, strict=True
    ):
        teeth = ramping.tool.teeth
        assert spindle_speed(trial, teeth, None) == pytest.approx(spindle_speed(even, teeth, None), rel=1e-4)
    assert as_turned(ramping).trials == ramping.trials


def test_a_column_that_the_force_speaks_against_is_not_followed(mill):
    dataset = mill()
    wrong, _ = _ramping(dataset.trials[1])
    wrong = replace(wrong, force_n=dataset.trials[1].force_n)
    (left,) = as_turned(replace(dataset, trials=(wrong,))).trials
    assert np.ptp(left.spindle_speed_measured_rev_s) == 0.0
    assert left.spindle_speed_measured_rev_s[0] == pytest.approx(wrong.spindle_speed_measured_rev_s.mean())


@pytest.mark.slow
def test_what_is_missing_is_found_on_ramps_too(ramping, monkeypatch):
    tried = ("radial_runout", "unequal_pitch", "size_effect")
    found = trace(ramping, effects=tried).verdict
    assert (found["verdict"], [each["name"] for each in found["effects"]]) == ("explained", ["radial_runout"])
    assert found["effects"][0]["parameters"]["offset_m"]["value"] == pytest.approx(1.2e-5, rel=0.02)
    heard = trace(_unmeasured(ramping), effects=tried).verdict
    assert heard["after"]["heldout_nrmse"] == pytest.approx(found["after"]["heldout_nrmse"], rel=0.1)
    monkeypatch.setattr("mjx_cutting.tracing.once.as_heard", lambda dataset: dataset)
    evenly = trace(_unmeasured(ramping), effects=tried).verdict
    assert found["after"]["heldout_nrmse"] < 0.1 * evenly["after"]["heldout_nrmse"]
