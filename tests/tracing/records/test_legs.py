"""A way forth and back is parted where it turns, not where the sensor jitters."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.tracing.records.legs import legs_of, smoothed, white_noise

FORTH = np.linspace(0.0, 0.02, 500)


@pytest.mark.parametrize("way_m", [FORTH, np.zeros(500), FORTH + 3e-6 * np.sin(np.arange(500))])
def test_a_tool_that_goes_one_way_has_one_leg(way_m):
    legs = legs_of(way_m)
    assert legs.forth.tolist() == [1.0] and not legs.leg.any()
    np.testing.assert_allclose(legs.gone_m, np.maximum.accumulate(way_m - way_m[0]))


@pytest.mark.parametrize("noise_m", [0.0, 2e-6, 2e-5])
def test_a_swing_has_a_leg_for_each_way(noise_m):
    """Of 0.5 mm to either side, four legs, of which the first and the last are half ones."""
    turns = np.linspace(0.0, 1.5, 3000)
    way_m = 5e-4 * np.sin(2.0 * np.pi * turns) + noise_m * np.random.default_rng(0).normal(size=3000)
    legs = legs_of(way_m)
    assert legs.forth.tolist() == [1.0, -1.0, 1.0, -1.0]
    np.testing.assert_allclose(legs.whole_m, [5e-4, 1e-3, 1e-3, 5e-4], atol=8.0 * noise_m + 1e-8)
    assert np.flatnonzero(np.diff(legs.leg)) / 2000.0 == pytest.approx([0.25, 0.75, 1.25], abs=0.06)


def test_noise_is_told_from_motion_and_smoothed_away():
    time_s = np.arange(4000) / 1000.0
    slow = 5e-4 * np.sin(2.0 * np.pi * 1.5 * time_s)
    noise = 4e-6 * np.random.default_rng(1).normal(size=4000)
    assert white_noise(slow + noise) == pytest.approx(4e-6, rel=0.1)
    assert np.std(smoothed(slow + noise) - slow) < 0.4 * 4e-6


def test_a_vibration_is_left_as_it_is():
    fast = 8e-6 * np.sin(2.0 * np.pi * 0.03 * np.arange(4000))
    np.testing.assert_allclose(smoothed(fast), fast, atol=8e-8)
