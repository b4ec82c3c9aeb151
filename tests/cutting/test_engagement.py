"""The engagement arc and the share of an angle step inside it."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.cutting import Cut, arc
from mjx_cutting.cutting.engagement import inside, wrap

DIAMETER = 0.05


def test_arcs_of_the_three_kinds(float64: None):
    swept = np.arccos(1.0 - 0.001 / 0.025)
    np.testing.assert_allclose(arc("slot", 0.001, DIAMETER), (0.0, np.pi))
    np.testing.assert_allclose(arc("conventional", 0.001, DIAMETER), (0.0, swept), rtol=1e-9)
    np.testing.assert_allclose(arc("climb", 0.001, DIAMETER), (np.pi - swept, np.pi), rtol=1e-9)


@pytest.mark.parametrize("depth", [0.0, -0.003])
@pytest.mark.parametrize("milling", ["conventional", "climb"])
def test_no_depth_no_arc(milling: str, depth: float):
    entry, exit_ = arc(milling, depth, DIAMETER)
    assert float(exit_ - entry) == 0.0
    assert float(inside(entry, entry, exit_, 0.01)) == 0.0


@pytest.mark.parametrize("milling", ["conventional", "climb"])
def test_a_depth_beyond_the_diameter_is_a_slot(milling: str):
    np.testing.assert_allclose(arc(milling, 0.08, DIAMETER), (0.0, np.pi), atol=1e-6)


def test_slope_of_the_arc_is_finite_at_both_ends(float64: None):
    slope = jax.vmap(jax.grad(lambda depth: arc("conventional", depth, DIAMETER)[1]))
    assert jnp.all(jnp.isfinite(slope(jnp.array([-1e-3, 0.0, 1e-6, 0.025, 0.05, 0.06]))))


def test_unknown_milling_names_the_choices():
    with pytest.raises(ValueError, match=r"'up'; expected one of slot, conventional, climb"):
        arc("up", 0.001, DIAMETER)


def test_shares_over_a_turn_add_up_to_the_arc(float64: None):
    steps = 101
    angle = 2.0 * np.pi / steps * np.arange(steps) + 0.3
    total = inside(angle, 0.2, 1.1, 2.0 * np.pi / steps).sum() * 2.0 * np.pi / steps
    np.testing.assert_allclose(total, 0.9, rtol=1e-12)


def test_share_does_not_mind_whole_turns(float64: None):
    angle = np.linspace(-1.0, 4.0, 31)
    np.testing.assert_allclose(
        inside(angle + 6.0 * np.pi, 0.0, 1.0, 0.1), inside(angle, 0.0, 1.0, 0.1), atol=1e-12
    )
    np.testing.assert_allclose(wrap(np.array([3.5 * np.pi, -np.pi, 0.4])), [-0.5 * np.pi, -np.pi, 0.4])


def test_a_sharp_gate_keeps_its_digits_in_float32():
    """Deep inside the arc the share is one and outside it is nought, however narrow the step."""
    angle = np.linspace(0.2, 2.9, 400, dtype=np.float32)
    share = np.asarray(inside(angle, 0.1, 3.0, 0.0))
    assert share.dtype == np.float32
    np.testing.assert_array_equal(share, 1.0)
    np.testing.assert_array_equal(inside(angle + np.float32(np.pi), 0.0, 3.0, 0.0), 0.0)


def test_a_step_wider_than_the_arc_counts_the_arc_only(float64: None):
    np.testing.assert_allclose(inside(0.55, 0.5, 0.6, 0.4), 0.25, rtol=1e-9)
    np.testing.assert_allclose(inside(0.55 + 0.2, 0.5, 0.6, 0.4), 0.125, rtol=1e-9)


def test_cut_replace_and_feed_per_revolution():
    cut = Cut.milling(
        "slot",
        DIAMETER,
        angle_rad=0.0,
        spindle_speed_rev_s=20.0,
        feed_speed_m_s=0.01,
        radial_depth_m=0.001,
        axial_width_m=0.002,
        time_s=3.0,
    )
    assert float(cut.feed_per_revolution_m()) == pytest.approx(5e-4)
    assert float(cut.replace(feed_speed_m_s=-0.01).feed_per_revolution_m()) == 0.0
    changed = cut.replace(time_s=4.0, spindle_speed_rev_s=40.0)
    assert (changed.time_s, changed.spindle_speed_rev_s, changed.feed_speed_m_s) == (4.0, 40.0, 0.01)
