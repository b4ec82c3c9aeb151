"""The spindle speed found from a force record."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mjx_cutting.tracing.records.motor import loaded_speeds, spindle_speeds
from mjx_cutting.tracing.records.spindle import spindle_angle, spindle_speed
from mjx_cutting.trials.dataset import AntiAlias, ToolInfo, Trial


def _tone(true_rev_s: float, rate_hz: float, seconds: float, order: int, noise: float) -> Trial:
    time = np.arange(int(rate_hz * seconds)) / rate_hz
    wave = np.cos(2 * np.pi * order * true_rev_s * time + 0.4)
    force = np.stack([wave, 0.3 * wave, 0 * wave], axis=1)
    force = force + noise * np.random.default_rng(0).normal(size=force.shape)
    return Trial(
        file="t.csv", kind="cut", milling="slot", spindle_speed_rev_s=20.0, feed_speed_m_s=0.01,
        radial_depth_m=0.01, axial_width_m=0.001, time_s=time, force_n=force,
    )  # fmt: skip


@pytest.mark.parametrize("deviation", [-0.009, -0.0013, 0.0, 0.0071])
def test_speed_off_nominal_is_found(deviation):
    true = 20.0 * (1.0 + deviation)
    found = spindle_speed(_tone(true, 1000.0, 4.0, order=3, noise=0.5), teeth=3, alias=None)
    # Cramer-Rao bound sqrt(6) sigma / (pi A order T sqrt(n)) = 5e-4 rev/s; twice that is allowed
    assert abs(found - true) < 1e-3


def test_a_line_folded_by_sampling_is_found():
    true = 19.0 * 1.004
    trial = dataclasses.replace(_tone(true, 500.0, 5.0, order=20, noise=0.2), spindle_speed_rev_s=19.0)
    assert abs(spindle_speed(trial, teeth=20, alias=None) - true) < 1e-3


def test_a_line_that_the_filter_holds_back_is_not_taken_for_a_stronger_one():
    """With 20 teeth and 500 Hz tooth passing at 526.6 Hz folds to where runout of 26.6 rev/s has its line."""
    trial = dataclasses.replace(_tone(26.607, 500.0, 5.0, order=1, noise=0.1), spindle_speed_rev_s=26.5)
    behind_a_filter = spindle_speed(trial, teeth=20, alias=AntiAlias("butterworth", 4, 200.0, False))
    assert behind_a_filter == pytest.approx(26.607, abs=0.01)
    assert spindle_speed(trial, teeth=20, alias=None) == pytest.approx((500.0 + 26.607) / 20, abs=0.01)


def test_tooth_passing_that_folds_beside_another_order_places_the_speed():
    """With 24 teeth and 1 kHz that of 24.985 rev/s folds to 400.36 Hz, where order 16 has its place."""
    trial = dataclasses.replace(_tone(24.985, 1000.0, 2.0, order=24, noise=0.2), spindle_speed_rev_s=25.0)
    assert spindle_speed(trial, teeth=24, alias=None) == pytest.approx(24.985, abs=1e-3)


def test_a_slow_change_is_not_taken_for_a_folded_harmonic():
    """With 28 teeth and 1 kHz the second harmonic of 17.85 rev/s folds to .4 Hz, where layers have most."""
    trial = dataclasses.replace(_tone(18.0, 1000.0, 6.0, order=28, noise=0.1), spindle_speed_rev_s=18.0)
    layers = 4.0 * np.sign(np.sin(2 * np.pi * 0.4 * trial.time_s))
    layered = dataclasses.replace(trial, force_n=trial.force_n + layers[:, None])
    assert spindle_speed(layered, teeth=28, alias=None) == pytest.approx(18.0, abs=1e-3)


def test_a_vibration_stronger_than_tooth_passing_is_not_taken_for_a_line_of_the_spindle():
    """At 90.6 Hz and tooth passings beside it, which fit the speed no better than one line fits any."""
    true = 19.93
    trial = _tone(true, 1000.0, 2.0, order=3, noise=0.05)
    turn = 2 * np.pi * trial.time_s
    shaken = 3.0 * np.cos(turn * 90.6) + 2.0 * np.cos(turn * (90.6 + 3 * true) + 1.0)
    trial = dataclasses.replace(trial, force_n=trial.force_n + shaken[:, None])
    assert spindle_speed(trial, teeth=3, alias=None) == pytest.approx(true, abs=0.01)


def test_a_measured_angle_is_believed():
    trial = _tone(20.1, 1000.0, 2.0, order=1, noise=0.1)
    angle = 2 * np.pi * 20.05 * trial.time_s + 0.7
    measured = dataclasses.replace(trial, spindle_angle_rad=np.mod(angle, 2 * np.pi))
    assert spindle_speed(measured, teeth=1, alias=None) == pytest.approx(20.05, abs=1e-6)
    np.testing.assert_allclose(
        spindle_angle(measured, 1.0) - angle, spindle_angle(measured, 1.0)[0] - angle[0], atol=1e-9
    )


def test_silence_keeps_the_nominal_speed():
    trial = _tone(20.0, 1000.0, 1.0, order=1, noise=0.0)
    assert spindle_speed(dataclasses.replace(trial, force_n=np.zeros((1000, 3))), teeth=2, alias=None) == 20.0


TOOL = ToolInfo("end_mill", 3, 0.02)
WIDTHS = (0.001, 0.002, 0.003, 0.004, 0.001, 0.003)


def _session(loss, strong_between: float = 0.0) -> tuple[list[Trial], np.ndarray]:
    """Slots of several widths, tooth passing and its harmonic at 20 rev/s less `loss` per metre of width."""
    trials, true = [], []
    for index, width in enumerate(WIDTHS):
        speed = 20.0 * (1.002 - loss * width)
        trial = _tone(speed, 1000.0, 2.0, order=3, noise=0.1)
        time = trial.time_s
        more = 0.4 * np.cos(2 * np.pi * 6 * speed * time + index)
        more = more + strong_between * np.cos(2 * np.pi * 2 * speed * time)
        trials.append(dataclasses.replace(trial, axial_width_m=width, force_n=trial.force_n + more[:, None]))
        true.append(speed)
    return trials, np.array(true)


def test_a_motor_that_gives_way_under_load_is_followed():
    trials, true = _session(loss=25.0)  # a tenth of the speed at the widest
    np.testing.assert_allclose(spindle_speeds(trials, TOOL, None), true, rtol=1e-4)


@pytest.mark.parametrize("between", [0.0, 3.0])
def test_an_even_spindle_is_not_left_for_a_comb_that_shares_its_lines(between):
    """With three teeth a spindle 3/4 as fast has tooth passing at its order 4; order 2 is runout here."""
    trials, true = _session(loss=0.0, strong_between=between)
    np.testing.assert_array_equal(loaded_speeds(trials, TOOL, None), 20.0)
    np.testing.assert_allclose(spindle_speeds(trials, TOOL, None), true, rtol=1e-4)
