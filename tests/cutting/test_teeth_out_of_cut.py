"""Teeth that start to touch in the middle of the arc: their edge force steps there, and the lines hold it."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, order_lines, orders
from mjx_cutting.cutting.effects import RadialRunout, UnequalPitch

ORDERS = 80
ERRORS = 0.03 * np.cos(2.1 * np.arange(20))


@pytest.mark.parametrize("feed_per_tooth_m", [5e-6, 2e-5])
def test_few_nodes_are_enough_where_teeth_touch_late(feed_per_tooth_m, monkeypatch):
    tool = Tool("slitting_saw", 20, 0.05, 0.0)
    effects = (RadialRunout(9e-6, 0.3), UnequalPitch(ERRORS - ERRORS.mean()))
    model = ForceModel(tool, Material(7e8, 8e3, 2e8, 6e3, 7e7, 1e3), effects)
    cut = Cut.milling(
        "conventional",
        tool.diameter_m,
        angle_rad=0.3,
        spindle_speed_rev_s=2.5,
        feed_speed_m_s=20 * 2.5 * feed_per_tooth_m,
        radial_depth_m=1.5e-3,
        axial_width_m=1.6e-3,
    )
    with jax.enable_x64(True):
        few = np.asarray(order_lines(model, cut, orders=ORDERS, angles=960, arc_rad=0.8))
        monkeypatch.setattr(orders, "_FEWEST_NODES", 2048)
        many = np.asarray(order_lines(model, cut, orders=ORDERS, angles=960, arc_rad=0.8))
        rigid = np.asarray(order_lines(ForceModel(tool, model.material), cut, ORDERS, 960, 0.8))
    size = np.sqrt(np.sum(np.abs(many) ** 2))
    assert np.sqrt(np.sum(np.abs(rigid - many) ** 2)) > 0.02 * size
    assert np.sqrt(np.sum(np.abs(few - many) ** 2)) < 1.5e-3 * size


def test_a_cut_of_no_depth_has_no_lines():
    tool = Tool("slitting_saw", 20, 0.05, 0.0)
    model = ForceModel(tool, Material(7e8, 8e3, 2e8, 6e3, 7e7, 1e3), (RadialRunout(9e-6, 0.3),))
    cut = Cut.milling(
        "conventional",
        tool.diameter_m,
        angle_rad=0.3,
        spindle_speed_rev_s=2.5,
        feed_speed_m_s=5e-4,
        radial_depth_m=0.0,
        axial_width_m=1.6e-3,
    )
    np.testing.assert_array_equal(order_lines(model, cut, orders=ORDERS, angles=960, arc_rad=0.8), 0.0)
