"""A force that is late against the measured angle is told by the phases at several speeds."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest

from mjx_cutting.tracing import trace
from mjx_cutting.tracing.along.offset import Phases, tells_phase
from mjx_cutting.trials.dataset import Dataset

SPEED = np.array([20.0, 20.1, 33.0, 33.2, 47.0, 47.1])


@pytest.mark.parametrize("delay_s", [0.0023, -0.004, 0.019])
def test_the_delay_is_found_whatever_the_zero_and_the_teeth_that_pass(delay_s):
    generator = np.random.default_rng(0)
    tooth = 2.0 * np.pi / 4 * generator.integers(0, 4, len(SPEED))
    phase = 1.3 - 2.0 * np.pi * SPEED * delay_s + tooth + 0.002 * generator.normal(size=len(SPEED))
    phases = Phases(phase, SPEED, 4)
    found = phases.delay(0.1)
    assert found == pytest.approx(delay_s, abs=3e-5)
    assert np.abs(phases.away(found)).max() < 0.01


def test_of_delays_that_do_as_well_the_shortest_is_taken():
    """At 20, 40 and 60 rev/s four teeth pass in the same 12.5 ms."""
    speed = np.array([20.0, 40.0, 60.0, 20.0, 40.0, 60.0])
    phases = Phases(-2.0 * np.pi * speed * 0.003, speed, 4)
    assert phases.delay(0.1) == pytest.approx(0.003, abs=1e-5)


def _with_angle(dataset: Dataset, delay_s: float) -> Dataset:
    """The trials with the angle of tooth 0 as an encoder with a zero of its own has it, the force late."""
    found = trace(dataset, effects=())
    trials = []
    for trial, each in zip(dataset.trials, found.after, strict=True):
        angle = each.angle_rad + 2.0 * np.pi * each.speed_rev_s * delay_s + 0.7
        trials.append(replace(trial, spindle_angle_rad=np.mod(angle, 2.0 * np.pi)))
    return replace(dataset, trials=tuple(trials))


@pytest.mark.parametrize("delay_s", [0.0, 0.003])
def test_a_late_force_is_named_and_an_encoder_with_another_zero_is_not(mill, delay_s):
    verdict = trace(_with_angle(mill(), delay_s), effects=["time_offset"]).verdict
    if delay_s == 0.0:
        assert verdict["effects"] == [] and verdict["verdict"] == "nothing missing"
        return
    (named,) = verdict["effects"]
    said = named["parameters"]["delay_s"]
    assert named["name"] == "time_offset" and said["low"] < delay_s < said["high"]
    assert said["value"] == pytest.approx(delay_s, rel=0.01)
    assert verdict["after"]["heldout_nrmse"] < 1.1 * verdict["noise_floor_nrmse"]
    assert verdict["before"]["heldout_nrmse"] > 5.0 * verdict["after"]["heldout_nrmse"]


def test_where_only_second_harmonics_are_heard_the_phase_is_not_told(mill):
    """From 350 to 500 Hz, 60 rev/s show 480 Hz alone of tooth passing, which half a tooth leaves as it is; of
    40 rev/s a little of 320 Hz leaks in beside 480 Hz."""

    def told(band_hz):
        found = trace(mill(), band_hz=band_hz, effects=())
        with jax.enable_x64(True):
            return tells_phase(found.dataset, found.lines, found.search)

    assert told((0.0, 1000.0)).all()
    slow, fast = np.split(told((350.0, 500.0)), 2)
    assert slow.any() and not fast.any()
