"""What a measured angle tells beyond the speed: a ripple, and what the filter makes of its sidebands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from mjx_cutting.tracing.records.turns import even_angle, filtered_turns, holds_ripple, reach
from mjx_cutting.trials.dataset import AntiAlias, Sensor, Trial

RATE_HZ, SPEED, TEETH = 4000.0, 23.0, 12
TIME = np.arange(8000) / RATE_HZ


def _trial(angle: np.ndarray, force: np.ndarray | None = None) -> Trial:
    wave = np.zeros(len(TIME)) if force is None else force
    return Trial(
        file="t.csv", kind="cut", milling="slot", spindle_speed_rev_s=SPEED, feed_speed_m_s=0.01,
        radial_depth_m=0.01, axial_width_m=0.001, time_s=TIME, force_n=np.stack([wave] * 3, axis=1),
        spindle_angle_rad=angle,
    )  # fmt: skip


def _turned(eps: float = 0.0, order: int = 4, noise: float = 0.0) -> np.ndarray:
    even = 2.0 * np.pi * SPEED * TIME + 0.6
    angle = even + eps / order * np.sin(order * even + 0.3)
    return angle + noise * np.random.default_rng(0).normal(size=len(TIME))


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_ripple_is_seen_in_the_angle_and_what_is_none_is_not(noise):
    assert holds_ripple(_trial(_turned(0.004, noise=noise)))
    assert not holds_ripple(_trial(_turned(noise=noise)))
    # off its centre, an encoder is uneven once a turn
    assert not holds_ripple(_trial(_turned(0.02, order=1, noise=noise)))


def test_an_angle_put_together_from_a_pulse_a_turn_holds_no_ripple():
    angle = _turned(0.01, order=3)
    pulses = np.arange(np.ceil(angle[0] / (2 * np.pi)), angle[-1] / (2 * np.pi)) * 2 * np.pi
    at = np.interp(pulses, angle, TIME)
    assert not holds_ripple(_trial(np.polyval(np.polyfit(at, pulses, 1), TIME)))
    assert not holds_ripple(replace(_trial(angle), spindle_angle_rad=None))


def _left(columns: np.ndarray, force: np.ndarray) -> float:
    kept = slice(400, None)
    both = np.stack([columns.real, columns.imag], axis=1)[kept]
    _, rest, *_ = np.linalg.lstsq(both, force[kept], rcond=None)
    return float(np.sqrt(rest[0] / np.sum(force[kept] ** 2)))


@pytest.mark.parametrize("corner_hz", [500.0, 180.0])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_line_along_an_uneven_angle_is_what_the_filter_passes(corner_hz, noise):
    """Tooth passing at 276 Hz, below and above the corner, through a filter of another's making."""
    true, seen = _turned(0.012), _turned(0.012, noise=noise)
    digital = signal.butter(4, corner_hz, fs=20.0 * RATE_HZ)
    fine = np.interp(np.arange(20 * len(TIME)) / 20.0, np.arange(len(TIME)), true)
    force = signal.lfilter(*digital, np.cos(TEETH * fine))[::20]
    sensor = Sensor(RATE_HZ, (0.1, 0.1, 0.1), anti_alias=AntiAlias(order=4, hz=corner_hz))
    plain = _left(np.exp(1j * TEETH * seen), force)
    through = _left(filtered_turns(seen, TEETH, sensor)[TEETH], force)
    assert plain > 0.008 and through < 0.1 * plain + 1.5 * TEETH * noise


def test_an_even_angle_and_a_sensor_without_a_filter_leave_the_columns_alone():
    for angle, alias in ((_turned(), AntiAlias(order=4, hz=500.0)), (_turned(0.01), None)):
        sensor = Sensor(RATE_HZ, (0.1, 0.1, 0.1), anti_alias=alias)
        expected = np.exp(1j * np.multiply.outer(np.arange(9), angle))
        np.testing.assert_allclose(filtered_turns(angle, 8, sensor), expected, atol=1e-9)


def test_sidebands_reach_as_far_as_the_order_of_the_ripple():
    assert reach(_trial(_turned(0.01, order=6))) == 6
    assert reach(_trial(_turned())) == 0


def test_the_straight_line_and_the_rest_are_the_angle():
    trial = _trial(np.mod(_turned(0.01), 2.0 * np.pi))
    even, uneven = even_angle(trial)
    np.testing.assert_allclose(even + uneven, np.unwrap(trial.spindle_angle_rad), atol=1e-9)
    assert np.abs(np.diff(even, 2)).max() < 1e-9 and np.abs(uneven).max() == pytest.approx(0.0025, rel=0.01)
