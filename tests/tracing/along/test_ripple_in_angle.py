"""A ripple that a finely measured angle holds is named, and an encoder's own fault is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from mjx_cutting.cutting.effects.torque_ripple import TorqueRipple
from mjx_cutting.tracing import trace
from mjx_cutting.trials.dataset import AntiAlias, Dataset, Sensor, ToolInfo
from mjx_cutting.trials.synthetic import Conditions, Sheet, make_trials

EFFECTS = ("torque_ripple", "radial_runout")
RIPPLE = TorqueRipple(0.04, 5.0, 0.4)


@pytest.fixture(scope="module")
def even():
    """Slots with an end mill that turns evenly."""
    cuts = [Conditions(f, f * 4 * chip, 0.016, 0.002) for f in (40.0, 60.0) for chip in (2e-5, 5e-5, 1.2e-4)]
    sheet = Sheet((8e8, 2.4e8, 1.2e8), (2e4, 1.6e4, 4e3))
    sensor = Sensor(5000.0, (0.5, 0.5, 1.0), anti_alias=AntiAlias(order=4, hz=1000.0, zero_phase=True))
    return make_trials(ToolInfo("end_mill", 4, 0.016), sheet, cuts, sensor, duration_s=0.8, seed=3)


def _rippling(dataset: Dataset, in_force: bool) -> Dataset:
    """The trials with the angle of an encoder that shows `RIPPLE`; the force follows it, as where chips are
    nothing beside edges, or turns evenly."""
    angles = {each.file: each.angle_rad for each in trace(dataset, effects=()).after}
    trials = []
    for trial in dataset.trials:
        angle = angles[trial.file]
        turned = angle + np.asarray(RIPPLE.ahead(angle))
        force = trial.force_n
        if in_force:
            when = np.interp(turned, angle, trial.time_s)
            force = CubicSpline(trial.time_s, force)(when)
        trials.append(replace(trial, force_n=force, spindle_angle_rad=np.mod(turned + 0.9, 2.0 * np.pi)))
    return replace(dataset, trials=tuple(trials))


def test_a_ripple_that_only_the_angle_shows_is_named_with_its_size_and_order(even):
    verdict = trace(_rippling(even, in_force=True), effects=EFFECTS).verdict
    (named,) = verdict["effects"]
    said = named["parameters"]
    assert named["name"] == "torque_ripple" and verdict["verdict"] == "explained"
    assert said["amplitude"]["value"] == pytest.approx(0.04, rel=0.02)
    assert said["order"]["value"] == 5.0
    assert verdict["before"]["heldout_nrmse"] > 1.3 * verdict["after"]["heldout_nrmse"]
    assert any("5 times a turn" in each for each in named["evidence"])


def test_a_fault_of_the_encoder_is_not_named(even):
    """The force turns evenly: along the angle its lines are lines no longer."""
    assert trace(_rippling(even, in_force=False), effects=EFFECTS).verdict["effects"] == []


def test_of_an_angle_that_grows_evenly_nothing_is_said(even):
    angles = {each.file: each.angle_rad for each in trace(even, effects=()).after}
    trials = tuple(replace(trial, spindle_angle_rad=angles[trial.file]) for trial in even.trials)
    assert trace(replace(even, trials=trials), effects=EFFECTS).verdict["effects"] == []
