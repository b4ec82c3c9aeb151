"""A spindle whose speed wanders within a record, and nothing measured it: the force tells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from mjx_cutting.tracing import trace
from mjx_cutting.tracing.along.predicted import predict_trials
from mjx_cutting.tracing.records.heard_speed import as_heard, speed_change
from mjx_cutting.tracing.records.spindle import spindle_angle, spindle_speed
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial
from mjx_cutting.trials.synthetic import Hidden

WANDERS = 2e-3
RUNOUT = Hidden(runout_m=1.2e-5, runout_angle_rad=0.7)


def _change(trial: Trial, times: float = 1.0, share: float = WANDERS) -> np.ndarray:
    """[T] a speed that swings `times` over the record, as a share of its mean."""
    change = share * np.sin(2.0 * np.pi * times * np.linspace(0.0, 1.0, len(trial.time_s)) + 0.6)
    return change - change.mean()


def _wandering(trial: Trial, change: np.ndarray) -> Trial:
    """The trial as cut by a spindle that turns faster by `change` [T]; the feed goes with it."""
    time = trial.time_s - trial.time_s[0]
    ahead = np.cumsum(change) * (time[1] - time[0])
    even = time + ahead - ahead[-1] * time / time[-1]
    return replace(trial, force_n=CubicSpline(time, trial.force_n)(even))


def _all_wandering(dataset: Dataset) -> Dataset:
    trials = [_wandering(each, _change(each, 0.5 + 0.4 * i)) for i, each in enumerate(dataset.trials)]
    return replace(dataset, trials=tuple(trials))


@pytest.mark.parametrize("times", [0.4, 1.0, 2.0])
@pytest.mark.parametrize("hidden", [Hidden(), RUNOUT], ids=["alike", "runout"])
def test_a_speed_that_wanders_is_heard(mill, hidden, times: float):
    dataset = mill(hidden)
    trial, teeth = dataset.trials[1], dataset.tool.teeth
    change = _change(trial, times)
    heard = speed_change(_wandering(trial, change), teeth, spindle_speed(trial, teeth, None))
    assert heard is not None
    ahead, left = (each - each.mean() for each in (np.cumsum(change), np.cumsum(change - heard)))
    line = np.linspace(-1.0, 1.0, len(left))
    left = left - line * (line @ left) / (line @ line)
    assert np.std(left) < 0.05 * np.std(ahead)


def test_what_turns_evenly_is_left_alone(mill):
    dataset = mill(RUNOUT)
    assert as_heard(dataset).trials == dataset.trials


def test_a_force_that_grows_moves_no_angle(mill):
    dataset = mill(RUNOUT)
    trial = dataset.trials[1]
    grown = 1.0 + 0.3 * np.sin(np.linspace(0.0, 7.0, len(trial.time_s)))
    growing = replace(trial, force_n=trial.force_n * grown[:, None])
    assert as_heard(replace(dataset, trials=(growing,))).trials == (growing,)


def test_a_line_that_moves_alone_is_not_the_spindle(mill):
    dataset = mill()
    trial, teeth = dataset.trials[1], dataset.tool.teeth
    passing = teeth * spindle_speed(trial, teeth, None) * 2.0 * np.pi * (trial.time_s - trial.time_s[0])
    moved = np.sin(passing + 1.5 * np.sin(np.linspace(0.0, 5.0, len(passing)))) - np.sin(passing)
    alone = replace(trial, force_n=trial.force_n + 0.5 * trial.force_n.std(axis=0) * moved[:, None])
    assert as_heard(replace(dataset, trials=(alone,))).trials == (alone,)


@pytest.mark.parametrize("speed", [50.0, 50.02, 50.08, 53.3])
def test_samples_that_drift_along_sharp_edges_are_no_speed(mill, speed: float):
    """Two straight teeth that leave at once, nearly 40 samples apart, as a sensor without a filter has them:
    of 53.3 rev/s the phases alone would say that the speed swings."""
    rate_hz = 4000.0
    time = np.arange(2400) / rate_hz
    own = (2.0 * np.pi * speed * time + 0.3) % np.pi
    chip = (own < 1.32) * np.sin(own)
    force = 60.0 * np.stack([-np.cos(own) * chip, np.sin(own) * chip, -0.1 * chip], axis=1)
    force += 0.3 * np.random.default_rng(0).normal(size=force.shape)
    trial = replace(mill().trials[0], time_s=time, force_n=force, spindle_speed_rev_s=speed)
    session = replace(
        mill(), tool=ToolInfo("end_mill", 2, 0.008), sensor=Sensor(rate_hz, None), trials=(trial,)
    )
    assert as_heard(session).trials == (trial,)


def test_a_measured_angle_is_believed(mill):
    dataset = mill()
    trial = _wandering(dataset.trials[1], _change(dataset.trials[1]))
    angle = spindle_angle(trial, trial.spindle_speed_rev_s)
    measured = replace(trial, spindle_angle_rad=angle)
    assert as_heard(replace(dataset, trials=(measured,))).trials == (measured,)


def test_the_mean_stays_as_stated_and_what_did_not_change_is_replaced(mill):
    dataset = mill()
    trial = _wandering(dataset.trials[1], _change(dataset.trials[1]))
    still = replace(trial, spindle_speed_measured_rev_s=np.full(trial.samples, 39.9))
    (heard,) = as_heard(replace(dataset, trials=(still,))).trials
    assert np.ptp(heard.spindle_speed_measured_rev_s) > WANDERS * 39.9
    assert heard.spindle_speed_measured_rev_s.mean() == pytest.approx(39.9, rel=1e-3)


@pytest.mark.slow
def test_what_is_missing_is_found_though_the_spindle_wanders(mill):
    dataset = mill(RUNOUT)
    tried = ("radial_runout", "unequal_pitch", "size_effect")
    evenly, found = (trace(each, effects=tried) for each in (dataset, _all_wandering(dataset)))
    assert [each["name"] for each in found.verdict["effects"]] == ["radial_runout"]
    assert found.verdict["verdict"] == evenly.verdict["verdict"] == "explained"
    assert found.final.nrmse < 1.2 * evenly.final.nrmse
    (told,) = (each for each in found.caveats if "wanders within the record" in each)
    assert told in found.verdict["remaining"]["description"]
    assert not any("wanders within the record" in each for each in evenly.caveats)
    again = predict_trials(_all_wandering(dataset), found.model)
    for one, other in zip(found.after, again, strict=True):
        assert np.sqrt(np.mean((one.predicted_n - other.predicted_n) ** 2)) < 0.01 * np.std(one.measured_n)
