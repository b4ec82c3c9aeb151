"""A force that is late against the measured angle is told by the phases at several speeds."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest

from mjx_cutting.tracing import predict_trials, trace
from mjx_cutting.tracing.along.offset import Phases, tells_phase
from mjx_cutting.trials.dataset import Dataset
from mjx_cutting.trials.synthetic import Conditions, Sheet, make_trials

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


def test_a_feed_that_varies_is_followed_as_late_as_the_force(mill):
    """Not as a stair of it, which is late too: of sheet without edge forces the force goes with the feed."""
    like, late_s = mill(), 0.008
    cuts = [
        Conditions(speed, speed * 4 * 6e-5, 0.016, 0.002) for speed in (40.0, 60.0, 50.0, 40.0, 60.0, 50.0)
    ]
    sheet = Sheet((8e8, 2.4e8, 1.2e8), (0.0, 0.0, 0.0))
    even = make_trials(like.tool, sheet, cuts, like.sensor, duration_s=0.8, bias_n=0.0, seed=5)
    even, trials = _with_angle(even, late_s), []
    knots = np.arange(-0.1, 1.0, 0.05)
    for index, each in enumerate(even.trials):
        walk = np.random.default_rng(index).normal(0.0, 0.12, len(knots))
        feed = each.feed_speed_m_s * (1.0 + np.interp(each.time_s, knots, walk))
        # every tooth cuts what was fed since the one before it, and the filter is late by itself
        before_s = (
            late_s
            + 2.613 / (2.0 * np.pi * 1000.0)
            + np.arange(0.5, 50.0) / 50.0 / (4.0 * each.spindle_speed_rev_s)
        )
        then = np.mean([np.interp(each.time_s - late, knots, walk) for late in before_s], axis=0)
        force = each.force_n * (1.0 + then)[:, None]
        trials.append(replace(each, force_n=force, feed_speed_measured_m_s=feed))
    dataset = replace(even, trials=tuple(trials))
    found = trace(dataset, effects=["time_offset", "command_stair"])
    verdict = found.verdict
    assert [each["name"] for each in verdict["effects"]] == ["time_offset"]
    assert verdict["effects"][0]["parameters"]["delay_s"]["value"] == pytest.approx(late_s, rel=0.02)
    assert verdict["after"]["heldout_nrmse"] < 1.2 * verdict["noise_floor_nrmse"]
    left = sum(np.sum(each.residual_n**2) for each in predict_trials(dataset, found.model))
    assert left < 1.2 * sum(np.sum(each.residual_n**2) for each in found.after)


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
