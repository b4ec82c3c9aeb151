"""An encoder's own error is left out of the measured angle, a spindle's ripple is not."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.tracing.records.followed_angle import as_followed
from mjx_cutting.trials.dataset import AntiAlias, Dataset, Sensor, ToolInfo, Trial

RATE_HZ, SPEED, TEETH = 2000.0, 20.0, 6
TIME = np.arange(4000) / RATE_HZ


def _session(order: int, follows: bool, kind: str = "end_mill") -> tuple[Dataset, np.ndarray]:
    """One cut whose measured angle swings `order` times a turn, on a spindle that also slows a little."""
    slowing = 2.0 * np.pi * SPEED * (TIME - 0.005 * TIME**2)
    measured = slowing + 0.01 * np.sin(order * slowing)
    turned = measured if follows else slowing
    wave = 3.0 + np.cos(TEETH * turned) + 0.4 * np.cos(2 * TEETH * turned + 1.0)
    force = np.stack([wave, 0.5 * wave, 0.0 * wave], axis=1)
    force = force + 0.02 * np.random.default_rng(1).normal(size=force.shape)
    trial = Trial(
        file="t.csv", kind="cut", milling="slot", spindle_speed_rev_s=SPEED, feed_speed_m_s=0.01,
        radial_depth_m=0.01, axial_width_m=0.001, time_s=TIME, force_n=force,
        spindle_angle_rad=np.mod(measured, 2.0 * np.pi),
    )  # fmt: skip
    sensor = Sensor(RATE_HZ, (0.02, 0.02, 0.02), anti_alias=AntiAlias(order=4, hz=900.0))
    told = {"name": "d", "source": "s", "licence": "l", "tool": ToolInfo(kind, TEETH, 0.016)}
    return Dataset(**told, sensor=sensor, trials=(trial,)), slowing


@pytest.mark.parametrize("order", [1, 2, 5])
def test_what_the_force_does_not_follow_is_left_out_and_slow_changes_stay(order):
    dataset, slowing = _session(order, follows=False)
    (left,) = as_followed(dataset).trials
    assert np.ptp(left.spindle_angle_rad - slowing) < 0.1 * 0.02
    assert np.abs(np.diff(left.spindle_angle_rad, 2)).max() < 1e-4


@pytest.mark.parametrize("order", [1, 2, 5])
def test_what_the_force_follows_stays(order):
    dataset, _ = _session(order, follows=True)
    assert as_followed(dataset).trials == dataset.trials


def test_levels_and_trials_without_an_angle_are_not_looked_at():
    dataset, _ = _session(2, follows=False, kind="drill")
    assert as_followed(dataset) is dataset
