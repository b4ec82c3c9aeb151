"""Lines that move along the path are straight between the places at which they are known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mjx_cutting.tracing.fitting.moving import MovingLines
from mjx_cutting.trials.dataset import Sensor

ORDERS, PLACES, RATE_HZ, SAMPLES = 6, 9, 1000.0, 500
THERE = np.linspace(0.0, 0.02, SAMPLES)
THERE_AND_BACK = 0.02 * np.sin(np.linspace(0.0, np.pi, SAMPLES)) ** 2


@pytest.mark.parametrize("way_m", [THERE, THERE_AND_BACK], ids=["forward", "there and back"])
def test_force_and_likeness_are_those_of_the_lines_at_each_place(way_m):
    generator = np.random.default_rng(3)
    places = generator.normal(size=(PLACES, ORDERS + 1, 3, 2)) @ [1.0, 1.0j]
    places[:, 0] = places[:, 0].real
    lines = SimpleNamespace(
        orders=ORDERS,
        present=np.ones((1, 2 * ORDERS + 1)),
        band_hz=(0.0, 0.5 * RATE_HZ),
        dataset=SimpleNamespace(sensor=Sensor(RATE_HZ)),
    )
    moving = MovingLines(lines, 0, places, way_m, RATE_HZ)
    angle = np.linspace(0.0, 61.0, SAMPLES)

    knots = np.linspace(way_m.min(), way_m.max(), PLACES)
    here = np.array(
        [[np.interp(way_m, knots, places[:, n, axis]) for axis in range(3)] for n in range(ORDERS + 1)]
    )

    def force(angle):
        turns = np.exp(1j * np.multiply.outer(np.arange(ORDERS + 1), angle))
        twice = np.where(np.arange(ORDERS + 1) == 0, 1.0, 2.0)
        return np.real(np.einsum("n,nt,nat->ta", twice, turns, here))

    np.testing.assert_allclose(moving.force(angle), force(angle), atol=1e-9)
    record = generator.normal(size=(SAMPLES, 3))
    likeness = moving.likeness(angle, record)
    turned = np.linspace(0.0, 6.0, 5)
    products = [np.sum(record * force(angle + p)) for p in turned]
    told = [np.real(np.sum(likeness * np.exp(1j * np.arange(ORDERS + 1) * p))) for p in turned]
    np.testing.assert_allclose(np.array(told), products, rtol=1e-9)
