"""Signatures of the effects at the chip: what each leaves in the order spectrum, and where."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, effect_class, order_lines

lines_of = jax.jit(order_lines, static_argnums=(2, 3))
force_of = jax.jit(ForceModel.process_force)

pytestmark = pytest.mark.usefixtures("float64")

SPEED, WIDTH = 50.0, 0.0015
FEEDS_M = np.array([2e-5, 4e-5, 8e-5, 1.6e-4])


def model(teeth: int, *effects: Any, edge: float = 1.0) -> ForceModel:
    material = Material.from_n_mm(950.0, 16.0 * edge, 250.0, 19.0 * edge)
    return ForceModel(Tool("end_mill", teeth, 0.025), material, effects)


def slot(chip_m: float, teeth: int) -> Cut:
    feed = chip_m * teeth * SPEED
    return Cut(0.0, SPEED, feed, 0.025, WIDTH, 0.0, np.pi)


def lines(the_model: ForceModel, chip_m: float, orders: int = 24) -> np.ndarray:
    teeth = the_model.tool.teeth
    return np.abs(np.asarray(lines_of(the_model, slot(chip_m, teeth), orders, 240 * teeth)))


def test_base_model_has_lines_at_tooth_passing_only():
    found = lines(model(3), 4e-5)
    others = [n for n in range(25) if n % 3]
    assert found[others].max() < 1e-6 * found[3].max()


@pytest.mark.parametrize("teeth", [2, 4])
def test_runout_line_is_flat_in_feed_on_both_axes(teeth: int):
    """About k_c b rho at every feed, while the mean grows; bounded below by drop-out at small chips."""
    rho = 4e-6
    runout = effect_class("radial_runout")(rho, 0.0)
    once = np.array([lines(model(teeth, runout), chip)[1] for chip in FEEDS_M])
    mean = np.array([lines(model(teeth, runout), chip)[0] for chip in FEEDS_M])
    assert np.all(once[:, :2] > 0.0)
    change = once[-1, :2] / once[0, :2]
    np.testing.assert_allclose(change, 1.0, atol=0.25)
    assert np.all(mean[-1, :2] > 2.0 * mean[0, :2])
    size = 950e6 * WIDTH * rho
    assert np.all((once[:, :2] > 0.02 * size) & (once[:, :2] < 2.0 * size))


def test_runout_saturates_when_teeth_drop_out():
    """Twice the offset doubles the line while all teeth cut, and not once some run idle."""
    kind = effect_class("radial_runout")
    small = [lines(model(4, kind(rho, 0.3)), 1e-4)[1, 1] for rho in (2e-6, 4e-6)]
    large = [lines(model(4, kind(rho, 0.3)), 1e-5)[1, 1] for rho in (3e-5, 6e-5)]
    assert small[1] / small[0] == pytest.approx(2.0, rel=0.03)
    assert large[1] / large[0] < 1.3


def test_runout_direction_acts_through_its_cosine_for_two_teeth():
    kind = effect_class("radial_runout")
    turned = lines(model(2, kind(1e-5, 1.0)), 8e-5)
    reduced = lines(model(2, kind(1e-5 * np.cos(1.0), 0.0)), 8e-5)
    np.testing.assert_allclose(turned, reduced, atol=1e-9)


def test_unequal_pitch_line_rises_with_feed_from_an_edge_intercept():
    pitch = effect_class("unequal_pitch")(jnp.array([0.03, -0.03]))
    once = np.array([lines(model(2, pitch), chip)[1, 1] for chip in FEEDS_M])
    bare = np.array([lines(model(2, pitch, edge=0.0), chip)[1, 1] for chip in FEEDS_M])
    slope, intercept = np.polyfit(FEEDS_M, once, 1)
    assert slope * FEEDS_M[-1] > 2.0 * intercept > 0.0
    np.testing.assert_allclose(bare / FEEDS_M, bare[0] / FEEDS_M[0], rtol=1e-9)


def test_unequal_pitch_shares_the_feed_by_the_gaps():
    error = np.array([0.05, -0.02, -0.03])
    the_model = model(3, effect_class("unequal_pitch")(jnp.asarray(error)))
    for tooth in range(3):
        cutter_lag = np.cumsum(error)[tooth] - error[0] + 2.0 * np.pi / 3.0 * tooth
        chip = jax.jit(ForceModel.chip)(the_model, slot(5e-5, 3).replace(angle_rad=cutter_lag + np.pi / 2))
        expected = 3 * (2.0 * np.pi / 3.0 + error[tooth]) / (2.0 * np.pi) * 5e-5
        np.testing.assert_allclose(chip.thickness_m[0, tooth], expected, rtol=1e-9)


def test_broken_tooth_line_rises_with_feed_from_an_edge_intercept():
    broken = effect_class("broken_tooth")(1.0, 0.0)
    once = np.array([lines(model(4, broken), chip)[1, 1] for chip in FEEDS_M])
    slope, intercept = np.polyfit(FEEDS_M, once, 1)
    assert slope * FEEDS_M[-1] > 2.0 * intercept > 0.0


def test_broken_tooth_leaves_its_chip_to_the_next():
    chip = model(3, effect_class("broken_tooth")(1.0, 1.0)).chip(
        slot(5e-5, 3).replace(angle_rad=np.pi / 2 + 2.0 * np.pi / 3.0 * np.arange(3))
    )
    removed = np.array([chip.thickness_m[j, 0, j] * chip.contact[j, 0, j] for j in range(3)])
    np.testing.assert_allclose(removed, [5e-5, 0.0, 1e-4], atol=1e-12)
    np.testing.assert_array_equal(np.asarray(chip.contact[1, 0, 1]), 0.0)


def test_a_tooth_is_whole_until_it_breaks():
    late, bare = model(4, effect_class("broken_tooth")(1.0, 0.0, 0.5)), model(4)
    for length, whole in ((0.0, True), (0.49, True), (0.51, False)):
        here = slot(5e-5, 4).replace(angle_rad=1.0, cut_length_m=length)
        assert bool(np.allclose(late.process_force(here), bare.process_force(here))) == whole


def test_broken_tooth_keeps_the_mean_chip_force():
    bare, broken = (
        lines(model(4, *effects, edge=0.0), 5e-5)[0]
        for effects in ((), (effect_class("broken_tooth")(1.0, 0.0),))
    )
    np.testing.assert_allclose(broken, bare, rtol=1e-9, atol=1e-9)


def test_helix_lag_loses_by_order_and_keeps_the_slot_mean():
    """The loss is the same at any speed, follows a sinc in the order, and spares the mean."""
    helix = effect_class("helix_lag")(0.6)
    lag = 2.0 * WIDTH * 8 * np.tan(0.6) / 0.025

    def found(speed: float, *effects: Any) -> np.ndarray:
        cut = slot(8e-5, 2).replace(
            spindle_speed_rev_s=speed, feed_speed_m_s=8e-5 * 2 * speed, axial_width_m=8 * WIDTH
        )
        return np.abs(np.asarray(lines_of(model(2, *effects), cut, 8, 960)))[:, 1]

    gain = {speed: found(speed, helix) / np.maximum(found(speed), 1e-12) for speed in (10.0, 50.0)}
    np.testing.assert_allclose(gain[10.0][::2], gain[50.0][::2], rtol=1e-9)
    expected = np.abs(np.sinc(np.array([0, 2, 4]) * lag / (2.0 * np.pi)))
    np.testing.assert_allclose(gain[50.0][[0, 2, 4]], expected, rtol=0.02)
    assert expected[2] < 0.9


def test_helix_lag_corrects_the_tools_own_helix():
    corrected = ForceModel(
        Tool("end_mill", 2, 0.025, 0.5), model(2).material, (effect_class("helix_lag")(0.2),)
    )
    drawn = ForceModel(Tool("end_mill", 2, 0.025, 0.7), model(2).material)
    cut = slot(5e-5, 2).replace(angle_rad=np.linspace(0.0, 6.0, 30))
    np.testing.assert_allclose(force_of(corrected, cut), force_of(drawn, cut), atol=1e-9)


def edge_cut(position: float, milling: str = "conventional", depth: float = 0.005) -> Cut:
    angle = 2.0 * np.pi / 240 * np.arange(240)
    return Cut.milling(
        milling,
        0.05,
        angle_rad=angle,
        spindle_speed_rev_s=20.0,
        feed_speed_m_s=0.01,
        radial_depth_m=depth,
        axial_width_m=0.0016,
        position_m=position,
        gate_rad=2.0 * np.pi / 240,
    )


def test_entry_takes_the_reach_of_the_arc_to_complete():
    """No force before the rim meets the sheet, all of it after sqrt(2 R a - a^2), growing in between."""
    tool = Tool("slitting_saw", 20, 0.05)
    ends = ForceModel(tool, model(1).material, (effect_class("entry_exit")(1.0, 0.02, 0.1),))
    steady = ForceModel(tool, model(1).material)
    radius, depth = 0.025, 0.005
    reach = np.sqrt(2 * radius * depth - depth**2)

    def load(position: float) -> float:
        return float(np.linalg.norm(np.asarray(force_of(ends, edge_cut(position))).mean(axis=0)))

    full = float(np.linalg.norm(np.asarray(force_of(steady, edge_cut(0.0))).mean(axis=0)))
    assert load(0.02 - 1e-4) == pytest.approx(0.0, abs=0.02 * full)
    assert load(0.02 + reach + 1e-3) == pytest.approx(full, rel=1e-9)
    assert load(0.05) == pytest.approx(full, rel=1e-9)
    growing = [load(0.02 + share * reach) for share in (0.2, 0.4, 0.6, 0.8)]
    assert np.all(np.diff(growing) > 0.0)
    # the rim passes the far end at 0.12; the last tooth is out when the axis has passed it too
    fading = [load(0.12 + share * reach) for share in (0.2, 0.5, 0.8)]
    assert load(0.12 - 1e-3) == pytest.approx(full, rel=1e-9)
    assert full > fading[0] > fading[1] > fading[2] > 0.0
    assert load(0.12 + reach + 1e-3) == pytest.approx(0.0, abs=1e-9)


def test_entry_engages_exactly_where_the_sheet_is():
    tool = Tool("slitting_saw", 1, 0.05)
    ends = ForceModel(tool, model(1).material, (effect_class("entry_exit")(1.0, 0.0, 1.0),))
    reach = np.sqrt(2 * 0.025 * 0.005 - 0.005**2)
    position = 0.4 * reach
    contact = np.asarray(ends.chip(edge_cut(position)).contact[:, 0, 0])
    angle = 2.0 * np.pi / 240 * np.arange(240)
    expected = (angle > np.arcsin((reach - position) / 0.025)) & (angle < np.arccos(1 - 0.005 / 0.025))
    assert np.abs(contact - expected).sum() <= 2.0


def test_an_axis_meets_the_sheet_where_its_rim_has_gone_in():
    """Positions of the axis are those of the rim less the way in, which differs with the depth."""
    tool = Tool("slitting_saw", 20, 0.05)
    by_rim, by_axis = (
        ForceModel(tool, model(1).material, (effect_class("entry_exit")(1.0, 0.02, 0.1, met),))
        for met in (0.0, 1.0)
    )
    for depth in (0.002, 0.005):
        reach = np.sqrt(2 * 0.025 * depth - depth**2)
        for place in (0.02 + 0.3 * reach, 0.12 + 0.6 * reach):
            expected = np.asarray(force_of(by_rim, edge_cut(place, depth=depth)))
            np.testing.assert_allclose(
                force_of(by_axis, edge_cut(place - reach, depth=depth)), expected, atol=1e-9
            )


@pytest.mark.parametrize("place_m", [0.0101, 0.018, 0.114, 0.121])
@pytest.mark.parametrize("share", [1.0, 0.6])
def test_lines_at_the_ends_of_the_sheet_are_exact(place_m, share):
    """Those of a tooth that meets the sheet within its arc, against fine steps of a turn."""
    tool, start_m, length_m, radius = Tool("end_mill", 1, 0.025), 0.01, 0.1, 0.0125
    ends = ForceModel(tool, model(1).material, (effect_class("entry_exit")(share, start_m, length_m),))
    cut, fine = slot(4e-5, 1).replace(position_m=place_m), 2**20
    angle = 2.0 * np.pi * np.arange(fine) / fine
    turn = cut.replace(angle_rad=angle, gate_rad=2.0 * np.pi / fine)
    tooth_m = place_m - start_m - radius + radius * np.sin(angle)
    outside = (tooth_m < 0.0) | (tooth_m > length_m)
    wave = np.asarray(force_of(model(1), turn)) * (1.0 - share * outside)[:, None]
    expected = np.fft.rfft(wave, axis=0)[:61] / fine
    found = np.asarray(order_lines(ends, cut, 60, 960))
    np.testing.assert_allclose(found, expected, atol=5e-4 * np.abs(expected).max())
    assert np.abs(expected[40:]).max() > 0.003 * np.abs(expected).max()


def test_lines_at_the_first_touch_have_a_slope():
    """A fit that begins where the rim just touches can move on."""
    tool, cut = Tool("end_mill", 3, 0.025), slot(4e-5, 3).replace(position_m=0.01)

    def size(start_m):
        ends = ForceModel(tool, model(1).material, (effect_class("entry_exit")(1.0, start_m, 1.0),))
        return jnp.sum(jnp.abs(order_lines(ends, cut, 12, 240)) ** 2)

    for start_m in (0.01, 0.0099, 0.02):
        assert np.isfinite(jax.grad(size)(start_m))
    assert jax.grad(size)(0.0099) < 0.0


@pytest.mark.parametrize("milling", ["slot", "conventional", "climb"])
def test_uneven_teeth_cut_to_the_ends_of_the_arc(milling: str):
    """Where the chips of all teeth go to nothing, none runs idle: a hair of unequal pitch changes nothing."""
    uneven = effect_class("unequal_pitch")(1e-9 * jnp.array([1.0, -1.0, 0.0]))
    tool, material = Tool("end_mill", 3, 0.012), Material.from_n_mm(40, 10, 15, 8, 3, 1)
    cut = Cut.milling(
        milling,
        tool.diameter_m,
        angle_rad=0.0,
        spindle_speed_rev_s=100.0,
        feed_speed_m_s=0.015,
        radial_depth_m=0.001,
        axial_width_m=0.005,
    )
    turn = cut.replace(angle_rad=2.0 * np.pi * np.arange(3600) / 3600)
    even, other = (ForceModel(tool, material, each) for each in ((), (uneven,)))
    lines = [np.asarray(order_lines(each, cut, 20, 240)) for each in (even, other)]
    waves = [np.asarray(ForceModel.process_force(each, turn)) for each in (even, other)]
    assert np.abs(lines[1] - lines[0]).max() < 1e-6 * np.abs(lines[0]).max()
    assert np.abs(waves[1].mean(axis=0) - waves[0].mean(axis=0)).max() < 3e-4 * np.abs(lines[0]).max()
