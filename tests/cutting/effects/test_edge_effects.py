"""Signatures of the effects at the edge and on the tool as a whole."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
import pytest

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, effect_class, order_lines, revolution

wave_of = jax.jit(revolution, static_argnums=2)
torque_of = jax.jit(ForceModel.torque_z)
lines_of = jax.jit(order_lines, static_argnums=(2, 3))
force_of = jax.jit(ForceModel.process_force)

pytestmark = pytest.mark.usefixtures("float64")

SPEED, WIDTH = 50.0, 0.0015
FEEDS_M = np.array([2e-5, 4e-5, 8e-5, 1.6e-4])


def model(teeth: int, *effects: Any, edge: float = 1.0) -> ForceModel:
    material = Material.from_n_mm(950.0, 16.0 * edge, 250.0, 19.0 * edge)
    return ForceModel(Tool("end_mill", teeth, 0.025), material, effects)


def slot(chip_m: float, teeth: int, **change: Any) -> Cut:
    feed = chip_m * teeth * SPEED
    return Cut(0.0, SPEED, feed, 0.025, WIDTH, 0.0, np.pi).replace(**change)


def lines(the_model: ForceModel, chip_m: float, orders: int = 24, **change: Any) -> np.ndarray:
    teeth = the_model.tool.teeth
    cut = slot(chip_m, teeth, **change)
    return np.abs(np.asarray(lines_of(the_model, cut, orders, 240 * teeth)))


def test_size_effect_is_concave_and_adds_no_lines():
    size = effect_class("size_effect")(0.3)
    found = np.array([lines(model(4, size), chip) for chip in FEEDS_M])
    others = [n for n in range(25) if n % 4]
    assert found[:, others].max() < 1e-4 * found.max()
    mean = found[:, 0, 1]
    slopes = np.diff(mean) / np.diff(FEEDS_M)
    assert np.all(np.diff(slopes) < 0.0)
    straight = np.array([lines(model(4), chip)[0, 1] for chip in FEEDS_M])
    straight_slopes = np.diff(straight) / np.diff(FEEDS_M)
    np.testing.assert_allclose(straight_slopes, straight_slopes[0], rtol=1e-6)


def test_size_effect_equals_the_base_law_at_its_reference():
    size = force_of(model(1, effect_class("size_effect")(0.4)), slot(5e-5, 1).replace(angle_rad=np.pi / 2))
    base = force_of(model(1), slot(5e-5, 1).replace(angle_rad=np.pi / 2))
    np.testing.assert_allclose(size, base, rtol=1e-9)


def test_ploughing_acts_at_low_feed_and_levels_off():
    """Below h_min the force is q times stiffer; well above it the surplus no longer grows."""
    h_min, ratio = 4e-6, 3.0
    ploughing = effect_class("ploughing")(h_min, ratio)
    peak = {"angle_rad": np.pi / 2}

    def surplus(chip: float) -> float:
        with_, without = (force_of(m, slot(chip, 1, **peak))[1] for m in (model(1, ploughing), model(1)))
        return float(with_ - without)

    tangential = 950e6 * WIDTH
    assert surplus(2e-6) == pytest.approx((ratio - 1) * tangential * 2e-6, rel=1e-9)
    assert surplus(1e-5) == pytest.approx((ratio - 1) * tangential * h_min, rel=1e-9)
    assert surplus(1e-4) == pytest.approx(surplus(1e-5), rel=1e-9)


def test_a_gradual_borderline_begins_and_ends_as_a_sharp_one():
    """As stiff where next to nothing is cut, the same edge force at high feed; in between 1 - 1/e of it."""
    h_min, ratio = 4e-6, 3.0
    gradual = effect_class("ploughing")(h_min, ratio, 1.0)
    peak = {"angle_rad": np.pi / 2}
    most = (ratio - 1) * 950e6 * WIDTH * h_min
    for chip, share in ((4e-9, 1e-3), (h_min, 1.0 - np.exp(-1.0)), (1e-4, 1.0)):
        with_, without = (force_of(m, slot(chip, 1, **peak))[1] for m in (model(1, gradual), model(1)))
        assert float(with_ - without) == pytest.approx(most * share, rel=1e-3)


def test_ploughing_may_be_stiffer_in_one_direction_than_in_another():
    ratio = np.array([2.0, 6.0, 1.0])
    ploughing = effect_class("ploughing")(4e-6, ratio)
    peak = slot(2e-6, 1, angle_rad=np.pi / 2)
    with_, without = (np.asarray(force_of(m, peak)) for m in (model(1, ploughing), model(1)))
    # at a right angle to the feed the tangential force is all of y, the radial one all of x
    chip = np.array(
        [np.asarray(force_of(m, slot(c, 1, angle_rad=np.pi / 2))) for c in (2e-6, 4e-6) for m in (model(1),)]
    )
    of_chip = chip[1] - chip[0]
    np.testing.assert_allclose(with_ - without, of_chip * (ratio[[1, 0, 2]] - 1.0), atol=1e-9)


def test_wear_grows_with_cut_length_and_not_with_the_clock():
    wear = effect_class("flank_wear")(np.array([1e9, 2e9, 5e8]), 1e-6)

    def mean(**change: Any) -> np.ndarray:
        return np.asarray(wave_of(model(2, wear), slot(4e-5, 2, **change), 480).mean(axis=0))

    sharp = mean()
    np.testing.assert_allclose(mean(time_s=500.0, clock_s=5000.0, position_m=0.4), sharp, rtol=1e-12)
    growth = np.array([mean(cut_length_m=length) - sharp for length in (5.0, 10.0, 20.0)])
    np.testing.assert_allclose(growth[1:] / growth[0], [[2.0] * 3, [4.0] * 3], rtol=1e-9)
    # slot: radial shows in x, tangential in y, both as edge forces N b kappa VB / pi
    share = 2 * WIDTH / np.pi * 1e-6 * 20.0
    np.testing.assert_allclose(growth[2][:2], [-2e9 * share, 1e9 * share], rtol=1e-4)


def test_wear_leaves_the_slope_in_feed_alone():
    wear = effect_class("flank_wear")(np.array([1e9, 2e9, 5e8]), 1e-6)
    slopes = [
        np.diff([lines(m, chip, cut_length_m=20.0)[0, 1] for chip in (4e-5, 8e-5)])
        for m in (model(2), model(2, wear))
    ]
    np.testing.assert_allclose(slopes[1], slopes[0], rtol=1e-9)


def test_wear_has_three_stages():
    wear = effect_class("flank_wear")(np.ones(3), 1e-6, 2e-5, 1.0, 5e-6, 50.0)
    length = np.array([0.0, 5.0, 20.0, 40.0, 60.0, 70.0])
    land = np.asarray(wear.land_m(length))
    rate = np.diff(land) / np.diff(length)
    assert land[0] == 0.0
    assert rate[0] > 2e-6
    np.testing.assert_allclose(rate[1:3], 1e-6, rtol=0.1)
    np.testing.assert_allclose(rate[4], 6e-6, rtol=1e-6)


def test_process_damping_opposes_the_plunge_and_fades_with_cutting_speed():
    damping = effect_class("process_damping")(5e5)

    def force(speed: float, **change: Any) -> np.ndarray:
        here = slot(
            4e-5, 1, spindle_speed_rev_s=speed, feed_speed_m_s=4e-5 * speed, angle_rad=np.pi / 2, **change
        )
        return np.asarray(force_of(model(1, damping), here) - force_of(model(1), here))

    np.testing.assert_allclose(force(20.0), 0.0, atol=1e-9)
    into = force(20.0, vibration_x_m_s=0.01)
    v_c = np.pi * 0.025 * 20.0
    np.testing.assert_allclose(into, [-5e5 * WIDTH * 0.01 / v_c, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(force(40.0, vibration_x_m_s=0.01), 0.5 * into, atol=1e-9)
    np.testing.assert_allclose(force(20.0, vibration_y_m_s=0.01), 0.0, atol=1e-9)


def test_clogging_sets_in_beyond_a_threshold_and_late_in_the_arc():
    clogging = effect_class("clogging")(2.0, 1e-6)

    def share(chip: float, angle: float) -> float:
        here = slot(chip, 1, angle_rad=angle)
        with_, without = (
            np.linalg.norm(force_of(m, here)) for m in (model(1, clogging, edge=0.0), model(1, edge=0.0))
        )
        return float(with_ / without)

    # area c R (1 - cos th) reaches 1e-6 m^2 at c = 1e-4 for th = 1.37 and never at c = 3e-5
    assert share(1e-4, 1.3) == pytest.approx(1.0)
    assert share(1e-4, 2.0) == pytest.approx(1.0 + 2.0 * (1e-4 * 0.0125 * (1 - np.cos(2.0)) / 1e-6 - 1.0))
    assert share(1e-4, 2.8) > share(1e-4, 2.0) > 1.0
    assert share(3e-5, 3.0) == pytest.approx(1.0)


@pytest.mark.parametrize("edge_share", [0.0, 0.4, 1.0])
def test_clogging_takes_its_share_of_the_edge_along(edge_share):
    clogging, here = effect_class("clogging")(2.0, 1e-6, edge_share), slot(1e-4, 1, angle_rad=2.0)
    rise = 2.0 * (1e-4 * 0.0125 * (1 - np.cos(2.0)) / 1e-6 - 1.0)
    bare, sheared = force_of(model(1), here), force_of(model(1, edge=0.0), here)
    expected = bare + rise * (sheared + edge_share * (bare - sheared))
    np.testing.assert_allclose(force_of(model(1, clogging), here), expected, rtol=1e-9)


@pytest.mark.parametrize(("feed_m_s", "power", "full_m"), [(4e-3, 0.4, 10e-3), (1e-3, 0.5, 20e-3)])
def test_a_drill_clogs_with_the_depth_of_the_hole(feed_m_s, power, full_m):
    """Two teeth at 20 rev/s fed 4 mm/s cut 1e-4 m each a turn: 1e-6 m^2 of chip in 10 mm. At a quarter of the
    feed, in proportion to its root, the flutes are full at twice the depth."""
    tool, steel = Tool("drill", 2, 0.008, 0.5), Material(1.5e9, 3e4, 1e9, 2e4, 8e8, 3e4)
    bare = ForceModel(tool, steel)
    full = bare.with_effects(effect_class("clogging")(0.5, 1e-6, 1.0, power))
    depth = full_m * np.array([0.0, 0.5, 1.0, 1.5, 2.0])
    hole = Cut(0.3, 20.0, feed_m_s, 4e-3, 4e-3, 0.0, 2.0 * np.pi, position_m=depth)
    expected = 1.0 + 0.5 * np.maximum(depth / full_m - 1.0, 0.0)
    clogged, empty = (np.asarray(each.process_force(hole)[..., 2]) for each in (full, bare))
    np.testing.assert_allclose(clogged / empty, expected, rtol=1e-9)
    np.testing.assert_allclose(np.asarray(full.torque_z(hole) / bare.torque_z(hole)), expected, rtol=1e-9)


def test_periodic_material_is_coherent_in_position():
    """The same positions give the same factor at twice the feed, so the line moves with v / Lam."""
    weave = effect_class("material_periodicity")(0.4, 5e-3, 0.3)
    position = np.linspace(0.0, 0.02, 41)
    here = slot(5e-5, 1, angle_rad=np.full(41, np.pi / 2), position_m=position)
    ratio = np.asarray(force_of(model(1, weave, edge=0.0), here) / force_of(model(1, edge=0.0), here))[:, 1]
    np.testing.assert_allclose(ratio, 1.0 + 0.4 * np.cos(2 * np.pi * position / 5e-3 + 0.3), rtol=1e-9)
    edge_only = force_of(model(1, weave), here) - force_of(model(1, weave, edge=0.0), here)
    np.testing.assert_allclose(edge_only[:, 1], edge_only[0, 1], rtol=1e-9)
    whole = effect_class("material_periodicity")(0.4, 5e-3, 0.3, edge_share=1.0)
    ratio = np.asarray(force_of(model(1, whole), here) / force_of(model(1), here))[:, 1]
    np.testing.assert_allclose(ratio, 1.0 + 0.4 * np.cos(2 * np.pi * position / 5e-3 + 0.3), rtol=1e-9)


def test_a_tooth_meets_a_pattern_where_it_is_and_not_where_the_centre_is():
    """A tooth at th is R sin th ahead: the factor is that of the centre, so much further on."""
    weave, met = (effect_class("material_periodicity")(0.4, 5e-3, 0.3, 0.5, place) for place in (0.0, 1.0))
    angle = np.linspace(0.2, 2.9, 41)
    here = slot(5e-5, 1, angle_rad=angle, position_m=np.linspace(0.0, 0.02, 41))
    further = here.replace(position_m=here.position_m + 0.0125 * np.sin(angle))
    np.testing.assert_allclose(force_of(model(1, met), here), force_of(model(1, weave), further), rtol=1e-9)


def test_layers_step_at_their_place():
    void = effect_class("layered_material")(-1.0, 0.03, 0.01)
    position = np.array([0.0, 0.0295, 0.0305, 0.035, 0.0395, 0.0405, 0.1])
    here = slot(5e-5, 1, angle_rad=np.full(7, np.pi / 2), position_m=position)
    ratio = np.asarray(force_of(model(1, void), here) / force_of(model(1), here))[:, 1]
    np.testing.assert_allclose(ratio, [1, 1, 0, 0, 0, 1, 1], atol=1e-9)


def test_unbalance_goes_with_the_square_of_the_speed_and_shows_in_air():
    unbalance = effect_class("unbalance")(2e-5, 0.4)
    found = []
    for speed in (20.0, 40.0):
        air = slot(5e-5, 4, spindle_speed_rev_s=speed, exit_rad=0.0, radial_depth_m=0.0)
        spectrum = np.abs(np.asarray(lines_of(model(4, unbalance), air, 6, 480)))
        np.testing.assert_allclose(spectrum[[0, 2, 3, 4, 5]], 0.0, atol=1e-9)
        found.append(spectrum[1, :2])
    np.testing.assert_allclose(2 * found[0], 2e-5 * (2 * np.pi * 20.0) ** 2, rtol=1e-9)
    np.testing.assert_allclose(found[1] / found[0], 4.0, rtol=1e-9)


def saw_cut(depth: float, feed: float = 0.0125) -> Cut:
    return Cut.milling(
        "conventional",
        0.05,
        angle_rad=0.3,
        spindle_speed_rev_s=19.0,
        feed_speed_m_s=feed,
        radial_depth_m=depth,
        axial_width_m=0.0016,
    )


@pytest.mark.parametrize("teeth", [10, 20])
def test_side_friction_goes_with_the_engaged_area(teeth: int):
    """Force and torque against integrals over the segment by brute force; neither feed nor teeth matter."""
    tool = Tool("slitting_saw", teeth, 0.05)
    base = ForceModel(tool, model(1).material)
    rubbing = base.with_effects(effect_class("side_friction")(3000.0))
    grid = (np.arange(2000) + 0.5) / 2000 * 0.05 - 0.025
    x, y = np.meshgrid(grid, grid)
    for depth in (0.001, 0.01, 0.025, 0.04):
        within = (x**2 + y**2 < 0.025**2) & (y > 0.025 - depth)
        cell = (0.05 / 2000) ** 2
        area, moment = 2 * within.sum() * cell, 2 * (np.hypot(x, y) * within).sum() * cell
        for feed in (0.005, 0.02):
            here = saw_cut(depth, feed)
            force = np.asarray(force_of(rubbing, here) - force_of(base, here))
            np.testing.assert_allclose(force, [-3000.0 * area, 0.0, 0.0], rtol=2e-3, atol=1e-9)
            torque = torque_of(rubbing, here) - torque_of(base, here)
            np.testing.assert_allclose(torque, 3000.0 * moment, rtol=2e-3)
    assert float(force_of(rubbing, saw_cut(0.0))[0]) == 0.0


def test_a_layer_of_another_material_changes_each_direction_by_its_own():
    layer = effect_class("layered_material")(-0.5, 0.03, 0.01, direction_share=np.array([1.0, 0.4, 0.0]))
    cut = slot(5e-5, 4).replace(position_m=0.035)
    for one, share in (
        (Material(9e8, 1e4, 0.0, 0.0, 0.0, 0.0), 0.5),
        (Material(0.0, 0.0, 2e8, 2e4, 0.0, 0.0), 0.8),
    ):
        bare = ForceModel(Tool("end_mill", 4, 0.025), one)
        np.testing.assert_allclose(
            force_of(bare.with_effects(layer), cut), share * force_of(bare, cut), rtol=1e-6
        )


@pytest.mark.parametrize("torque_power", [2.0, 1.0])
def test_lips_of_a_drill_bring_the_torque_of_a_layer_later_than_its_thrust(torque_power: float):
    """Half way in, half of the lips' length is in the layer, and a quarter of the lever it works at; of
    layers that blend, half of that too."""
    half = 0.5**torque_power
    drill = ForceModel(Tool("drill", 2, 0.006), Material.from_n_mm(900.0, 20.0, 0.0, 0.0, 700.0, 30.0))
    layered = drill.with_effects(
        effect_class("layered_material")(0.4, 0.01, 0.02, 0.002, torque_power=torque_power)
    )

    def more(place_m: float) -> np.ndarray:
        cut = Cut(0.0, 30.0, 0.003, 0.003, 0.003, 0.0, 2.0 * np.pi, position_m=place_m)
        thrust = [force_of(each, cut)[2] for each in (layered, drill)]
        torque = [torque_of(each, cut) for each in (layered, drill)]
        return np.array([thrust[0] / thrust[1], torque[0] / torque[1]]) - 1.0

    np.testing.assert_allclose(more(0.008), 0.0, atol=1e-9)
    np.testing.assert_allclose(more(0.01), [0.5 * 0.4, half * 0.4], rtol=1e-6)
    np.testing.assert_allclose(more(0.02), 0.4, rtol=1e-6)
    np.testing.assert_allclose(more(0.03), [0.5 * 0.4, (1.0 - half) * 0.4], rtol=1e-6)
