"""Tool and material: units and bad input."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.cutting import Material, Tool


def test_lags_of_the_teeth():
    np.testing.assert_allclose(Tool("slitting_saw", 4, 0.05).pitch_rad, [0.0, np.pi / 2, np.pi, 1.5 * np.pi])


def test_a_straight_edge_needs_one_slice():
    assert Tool("end_mill", 2, 0.01).slices == 1
    assert Tool("end_mill", 2, 0.01, 0.5).slices > 1
    assert Tool("end_mill", 2, 0.01, 0.5, slices=3).slices == 3


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("router", 2, 0.01), r"'router'; expected one of end_mill"),
        (("end_mill", 0, 0.01), r"at least 1; got 0"),
        (("end_mill", 2.5, 0.01), r"whole number of teeth"),
        (("end_mill", 2, 50.0), r"expected metres between 0 and 2 \(50 mm is 0.05\)"),
        (("end_mill", 2, 0.0), r"expected metres"),
        (("end_mill", 2, 0.01, 45.0), r"45 deg is 0.785"),
    ],
)
def test_bad_tools(arguments: tuple, message: str):
    with pytest.raises(ValueError, match=message):
        Tool(*arguments)


def test_units_of_the_literature():
    material = Material.from_n_mm(796.0, 27.7, 168.8, 30.8, 10.0, 2.0)
    np.testing.assert_allclose(material.chip_n_m2, [796e6, 168.8e6, 10e6], rtol=1e-6)
    np.testing.assert_allclose(material.edge_n_m, [27.7e3, 30.8e3, 2e3], rtol=1e-6)


def test_batched_constants_keep_their_axis():
    material = Material(np.array([1e9, 2e9]), 1e4, 2e8, 1e4)
    assert material.chip_n_m2.shape == (2, 3)
    assert material.edge_n_m.shape == (3,)
