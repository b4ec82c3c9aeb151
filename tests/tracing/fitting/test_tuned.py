"""Speed and phase of a trial are found beneath lines that grow along its path."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mjx_cutting.tracing.fitting.moving import MovingLines
from mjx_cutting.tracing.fitting.tuned import tuned_angle
from mjx_cutting.trials.dataset import Sensor

TEETH, ORDERS, RATE_HZ, SPEED_REV_S, SECONDS = 4, 24, 4000.0, 40.0, 0.6


def _growing() -> MovingLines:
    """Lines at tooth passing, and a little once a turn, that grow from nothing along the way."""
    generator, line = np.random.default_rng(1), np.zeros((ORDERS + 1, 3), complex)
    line[::TEETH] = generator.normal(size=(7, 3, 2)) @ [1.0, 1.0j] / np.arange(1, 8)[:, None] ** 2 * 50.0
    line[1] = [0.5, 0.3, 0.1]
    places = np.linspace(0.0, 1.0, 33)[:, None, None] ** 0.5 * line
    lines = SimpleNamespace(
        orders=ORDERS,
        present=np.ones((1, 2 * ORDERS + 1)),
        band_hz=(0.0, 0.5 * RATE_HZ),
        dataset=SimpleNamespace(sensor=Sensor(RATE_HZ)),
    )
    return MovingLines(lines, 0, places, np.linspace(0.0, 0.01, round(RATE_HZ * SECONDS)), RATE_HZ)


@pytest.mark.parametrize("known", [False, True], ids=["speed unknown", "angle measured"])
@pytest.mark.parametrize("off", [-0.008, 0.0, 0.0043])
def test_speed_and_phase_are_found_again(known, off):
    time = np.arange(round(RATE_HZ * SECONDS)) / RATE_HZ
    true = 2.0 * np.pi * SPEED_REV_S * (1.0 + (0.0 if known else off)) * time + 1.234
    moving = _growing()
    noise = np.random.default_rng(2).normal(0.0, 0.5, (len(time), 3))
    measured = moving.force(true) + noise + np.array([3.0, -20.0, 5.0])
    found = tuned_angle(moving, 2.0 * np.pi * SPEED_REV_S * time + off, known, TEETH, measured, np.ones(3))
    away = np.angle(np.exp(1j * (found - true)))
    assert np.abs(away).max() < 0.01
