"""A residual replayed at another spindle speed keeps its shape over the angle and its share of the force."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mjx_cutting.loop.transfer import replayed
from mjx_cutting.tracing import Prediction


def _trial(start_rad: float, size: float) -> Prediction:
    time = np.arange(20_000) / 10_000.0
    angle = start_rad + 2 * np.pi * 50.0 * time
    left = size * np.stack([np.cos(angle), np.sin(2 * angle), 0 * angle], axis=1)
    whole = size * np.stack([10 + 0 * angle, 0 * angle, 0 * angle], axis=1)
    return Prediction("t.csv", time, angle, whole, whole - left, 50.0, np.zeros(3))


def test_every_trial_starts_at_the_same_tooth_and_turns_at_the_new_speed():
    time, residual = replayed(
        [_trial(0.3, 1.0), _trial(5.0, 1.0)], speed_rev_s=19.0, rate_hz=500.0, load_n=10.0
    )
    expected = np.stack([np.cos(2 * np.pi * 19 * time), np.sin(4 * np.pi * 19 * time), 0 * time], axis=1)
    np.testing.assert_allclose(residual[0], expected, atol=2e-3)
    np.testing.assert_allclose(residual[1], expected, atol=2e-3)


def test_size_keeps_its_share_of_the_force():
    _, weak = replayed([_trial(0.0, 1.0)] * 2, 19.0, 500.0, load_n=10.0)
    _, strong = replayed([_trial(0.0, 7.0)] * 2, 19.0, 500.0, load_n=10.0)
    np.testing.assert_allclose(weak, strong, atol=1e-9)
    _, doubled = replayed([_trial(0.0, 1.0)] * 2, 19.0, 500.0, load_n=20.0)
    np.testing.assert_allclose(doubled, 2 * weak, atol=1e-9)


def test_a_trial_of_less_than_two_turns_is_refused():
    short = _trial(0.1, 1.0)
    records = ("time_s", "angle_rad", "measured_n", "predicted_n")
    cut = dataclasses.replace(short, **{name: getattr(short, name)[:500] for name in records})
    with pytest.raises(ValueError, match="at least 2 are needed"):
        replayed([cut, cut], 19.0, 500.0, 10.0)
