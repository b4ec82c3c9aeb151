"""What must hold for any constants: limits, symmetries and scalings of the base force and of carry-over."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, effect_class, revolution

pytestmark = pytest.mark.usefixtures("float64")

CHIP_ONLY = Material.from_n_mm(900.0, 0.0, 300.0, 0.0, 120.0, 0.0)
EDGE_ONLY = Material.from_n_mm(0.0, 25.0, 0.0, 18.0, 0.0, 6.0)
BOTH = Material.from_n_mm(900.0, 25.0, 300.0, 18.0, 120.0, 6.0)
wave_of = jax.jit(revolution, static_argnums=2)
force_of = jax.jit(ForceModel.process_force)
chip_of = jax.jit(ForceModel.chip)
SPEED, FEED, WIDTH = 19.0, 0.0125, 0.0016


def cut(milling: str = "conventional", depth: float = 0.004, diameter: float = 0.05, **change: float) -> Cut:
    given = {
        "angle_rad": 0.0,
        "spindle_speed_rev_s": SPEED,
        "feed_speed_m_s": FEED,
        "radial_depth_m": depth,
        "axial_width_m": WIDTH,
        **change,
    }
    return Cut.milling(milling, diameter, **given)


def wave(
    material: Material, teeth: int = 20, helix: float = 0.0, effects: tuple = (), angles: int = 720, **change
):
    model = ForceModel(Tool("slitting_saw", teeth, 0.05, helix), material, effects)
    return np.asarray(wave_of(model, cut(**change), angles))


@pytest.mark.parametrize("helix", [0.2, 0.785, -0.5])
def test_full_slot_mean_does_not_depend_on_helix(helix: float):
    straight = wave(BOTH, 2, 0.0, milling="slot", axial_width_m=0.01).mean(axis=0)
    turned = wave(BOTH, 2, helix, milling="slot", axial_width_m=0.01).mean(axis=0)
    np.testing.assert_allclose(turned, straight, rtol=1e-4)
    ripple = [np.std(wave(BOTH, 2, beta, milling="slot", axial_width_m=0.01)[:, 1]) for beta in (0.0, helix)]
    assert ripple[1] < ripple[0]


def test_chip_part_is_blind_to_the_number_of_teeth_and_edge_part_grows_with_it():
    chip = {n: wave(CHIP_ONLY, n, angles=7200).mean(axis=0) for n in (5, 10, 20)}
    edge = {n: wave(EDGE_ONLY, n, angles=7200).mean(axis=0) for n in (5, 10, 20)}
    for n in (5, 10):
        np.testing.assert_allclose(chip[n], chip[20], rtol=1e-4)
        np.testing.assert_allclose(edge[n] * 20 / n, edge[20], rtol=1e-9)


@pytest.mark.parametrize("milling", ["slot", "conventional"])
def test_carry_over_runout_keeps_the_mean_chip_force_and_lowers_the_edge_force(milling: str):
    """Every layer that is fed gets cut by some tooth, up to 60 um; idle teeth do not rub."""
    runout = effect_class("radial_runout")
    offsets = (0.0, 2e-6, 1e-5, 6e-5)

    def means(material: Material) -> np.ndarray:
        return np.array(
            [
                wave(
                    material,
                    8,
                    effects=(runout(rho, 0.4),),
                    milling=milling,
                    angles=2880,
                    feed_speed_m_s=0.003,
                ).mean(axis=0)
                for rho in offsets
            ]
        )

    chip, edge = means(CHIP_ONLY), means(EDGE_ONLY)
    for row in chip[1:]:
        np.testing.assert_allclose(row, chip[0], rtol=2e-3, atol=2e-3 * np.abs(chip[0]).max())
    contact = np.linalg.norm(edge, axis=1)
    assert contact[0] >= contact[1] > contact[2] > contact[3]
    assert contact[3] < 0.6 * contact[0]


def test_without_carry_over_the_saw_would_remove_too_much():
    """The naive chip max(0, c sin + r_j - r_{j-1}) removes far more than is fed; the one in use does not."""
    teeth, rho, shallow = 20, 6e-5, cut(depth=0.001)
    model = ForceModel(Tool("slitting_saw", teeth, 0.05), BOTH, (effect_class("radial_runout")(rho, 0.0),))
    angle = 2.0 * np.pi / 720 * np.arange(720)
    chip = chip_of(model, shallow.replace(angle_rad=angle))
    arc = np.asarray(chip_of(ForceModel(model.tool, BOTH), shallow.replace(angle_rad=angle)).contact[:, 0])
    removed = np.mean(np.sum(np.asarray(chip.thickness_m)[:, 0] * arc, axis=-1))
    radius = rho * np.cos(-2.0 * np.pi * np.arange(teeth) / teeth)
    even = FEED / (teeth * SPEED) * np.sin(np.asarray(chip.angle_rad)[:, 0])
    naive = np.maximum(0.0, even + radius - np.roll(radius, 1))
    fed = np.mean(np.sum(even * arc, axis=-1))
    assert removed == pytest.approx(fed, rel=0.01)
    assert np.mean(np.sum(naive * arc, axis=-1)) > 1.3 * fed


def test_zero_chip_leaves_the_edge_force():
    np.testing.assert_allclose(
        wave(BOTH, feed_speed_m_s=0.0), wave(EDGE_ONLY, feed_speed_m_s=0.0), atol=1e-12
    )
    assert np.abs(wave(EDGE_ONLY, feed_speed_m_s=0.0)).max() > 1.0


def test_backing_away_removes_nothing():
    np.testing.assert_allclose(wave(CHIP_ONLY, feed_speed_m_s=-FEED), 0.0, atol=1e-15)


def test_no_depth_no_force():
    np.testing.assert_array_equal(wave(BOTH, depth=0.0), 0.0)


def test_linear_in_width_and_in_the_constants():
    np.testing.assert_allclose(wave(BOTH, axial_width_m=2 * WIDTH), 2 * wave(BOTH), rtol=1e-12)
    np.testing.assert_allclose(wave(BOTH), wave(CHIP_ONLY) + wave(EDGE_ONLY), rtol=1e-11, atol=1e-11)


def test_chip_force_depends_on_feed_over_speed_only():
    np.testing.assert_allclose(
        wave(BOTH), wave(BOTH, feed_speed_m_s=3 * FEED, spindle_speed_rev_s=3 * SPEED), rtol=1e-11
    )


@pytest.mark.parametrize("helix", [0.0, 0.6])
def test_a_shift_by_a_whole_tooth_changes_nothing(helix: float):
    pitch = 2.0 * np.pi / 20
    np.testing.assert_allclose(
        wave(BOTH, helix=helix, angle_rad=3 * pitch), wave(BOTH, helix=helix), atol=1e-9
    )
    assert np.abs(wave(BOTH, helix=helix, angle_rad=0.4 * pitch) - wave(BOTH, helix=helix)).max() > 0.1


def test_frames_rotate_with_the_arc():
    """A narrow arc at angle phi carries (-cos, sin) of the tangential and -(sin, cos) of the radial force."""
    tool = Tool("end_mill", 1, 0.02)
    for phi in (0.3, 1.2, 2.9):
        here = cut("slot").replace(angle_rad=phi, entry_rad=phi - 0.01, exit_rad=phi + 0.01)
        tangential, radial = 25e3 * WIDTH, 18e3 * WIDTH
        force = force_of(ForceModel(tool, EDGE_ONLY), here)
        expected = [
            -tangential * np.cos(phi) - radial * np.sin(phi),
            tangential * np.sin(phi) - radial * np.cos(phi),
            -6e3 * WIDTH,
        ]
        np.testing.assert_allclose(force, expected, rtol=1e-9)


def test_climb_mirrors_conventional():
    """Seen in a mirror across y, a climb cut is a conventional one with the tangential force reversed."""
    only_radial = Material.from_n_mm(0.0, 0.0, 300.0, 18.0)
    only_tangential = Material.from_n_mm(900.0, 25.0, 0.0, 0.0)
    mean = {
        (name, kind): wave(material, milling=kind, angles=3600).mean(axis=0)
        for name, material in (("radial", only_radial), ("tangential", only_tangential))
        for kind in ("conventional", "climb")
    }
    mirror = np.array([1.0, -1.0, 1.0])
    np.testing.assert_allclose(mean["radial", "climb"], mirror * mean["radial", "conventional"], atol=1e-9)
    np.testing.assert_allclose(
        mean["tangential", "climb"], -mirror * mean["tangential", "conventional"], atol=1e-9
    )


def test_a_spindle_line_is_not_made_by_the_sampling():
    """Even teeth give no line at the spindle frequency on a grid that does not divide the tooth passing."""
    model = ForceModel(Tool("slitting_saw", 20, 0.05), BOTH)
    rate, turns = 4000.0, 19
    time = np.arange(int(rate)) / rate
    angle = 2.0 * np.pi * SPEED * time
    step = 2.0 * np.pi * SPEED / rate
    smooth = np.asarray(force_of(model, cut(gate_rad=step).replace(angle_rad=angle)))
    lines = np.abs(np.fft.rfft(smooth[:, 0])) / len(time)
    assert lines[turns] < 1e-3 * lines[20 * turns]
