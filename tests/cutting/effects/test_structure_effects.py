"""Signatures of the effects of robot, sheet and drive."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, effect_class, order_lines, revolution
from mjx_cutting.cutting.average import mean_load
from mjx_cutting.cutting.effects.entry_exit import part_of_arc

pytestmark = pytest.mark.usefixtures("float64")

SPEED, DIAMETER = 19.0, 0.05
REACH_SHARE = np.sqrt(0.002 * (DIAMETER - 0.002)) / (0.5 * DIAMETER)
"""Way from the first touch of a sheet until the arc of a cut 2 mm deep is full, over the radius."""
TOOL = Tool("slitting_saw", 20, DIAMETER)
MATERIAL = Material.from_n_mm(900.0, 20.0, 400.0, 30.0, 50.0, 3.0)


@jax.jit
def bent_by(compliance: Any, here: Cut) -> tuple[Cut, Any]:
    """The cut that static compliance leaves, and the mean force there."""
    soft = effect_class("static_compliance")(compliance)
    bent = soft.engage(here, model().process_force, model())
    return bent, mean_load(model(), bent).force


wave_of = jax.jit(revolution, static_argnums=2)
predict = jax.jit(ForceModel.predict)
lines_of = jax.jit(order_lines, static_argnums=(2, 3))


def model(*effects: Any) -> ForceModel:
    return ForceModel(TOOL, MATERIAL, effects)


def cut(milling: str = "conventional", depth: float = 0.002, **change: Any) -> Cut:
    given = {
        "angle_rad": 0.0,
        "spindle_speed_rev_s": SPEED,
        "feed_speed_m_s": 0.0125,
        "radial_depth_m": depth,
        "axial_width_m": 0.0016,
        **change,
    }
    return Cut.milling(milling, DIAMETER, **given)


@pytest.mark.parametrize("milling", ["conventional", "climb"])
@pytest.mark.parametrize("stiffness", [2e4, 2e5, 1e6])
def test_compliance_balances_depth_and_force(milling: str, stiffness: float):
    """At the depth found, the spring carries exactly the mean normal force: a = a_cmd + F_y(a) / K."""
    bent, force = bent_by(1.0 / stiffness, cut(milling))
    found = float(bent.radial_depth_m)
    push = float(force[1]) * (1.0 if milling == "conventional" else -1.0)
    assert push < 0.0
    np.testing.assert_allclose(found, 0.002 + push / stiffness, rtol=1e-7)
    assert 0.0 < found < 0.002
    again = cut(milling, found)
    np.testing.assert_allclose([bent.entry_rad, bent.exit_rad], [again.entry_rad, again.exit_rad], atol=1e-9)


@pytest.mark.parametrize("milling", ["conventional", "climb"])
@pytest.mark.parametrize("stiffness", [2e4, 2e5])
def test_beside_runout_the_teeth_that_cut_carry_the_spring(milling: str, stiffness: float):
    """At a small feed many teeth do not reach the sheet: the force is less than of a tool that runs true."""
    run_out = model(effect_class("radial_runout")(1.4e-5, 0.6))
    soft, here = effect_class("static_compliance")(1.0 / stiffness), cut(milling, feed_speed_m_s=0.003)

    @jax.jit
    def bent_beside(given: Cut) -> tuple[Cut, Any]:
        bent = soft.engage(given, run_out.process_force, run_out)
        return bent, mean_load(run_out, bent).force[1]

    bent, force = bent_beside(here)
    push = float(force) * (1.0 if milling == "conventional" else -1.0)
    true, _ = bent_by(1.0 / stiffness, here)
    assert true.radial_depth_m + 1e-6 < bent.radial_depth_m < 0.002
    np.testing.assert_allclose(bent.radial_depth_m, 0.002 + push / stiffness, rtol=2e-3)


@pytest.mark.parametrize("milling", ["conventional", "climb", "slot"])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9])
def test_a_stiff_arm_meets_the_end_of_a_sheet_as_a_rigid_one(milling: str, share: float):
    """Share of the way in; teeth meet the foremost part of their arc."""
    part = part_of_arc(cut(milling), (1.0 - share) * REACH_SHARE)
    found, _ = bent_by(1e-12, part)
    np.testing.assert_allclose([found.entry_rad, found.exit_rad], [part.entry_rad, part.exit_rad], atol=1e-6)


@pytest.mark.parametrize("milling", ["conventional", "climb"])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_at_the_end_of_a_sheet_the_spring_carries_the_force_there(milling: str, share: float):
    """The arc still begins where the sheet does; its wall stands where the balance has it."""
    part = part_of_arc(cut(milling), (1.0 - share) * REACH_SHARE)
    bent, force = bent_by(1e-5, part)
    push = float(force[1]) * (1.0 if milling == "conventional" else -1.0)
    found = float(bent.radial_depth_m)
    assert push < 0.0
    np.testing.assert_allclose(found, 0.002 + push * 1e-5, rtol=1e-7)
    wall = np.arccos(1.0 - found / (0.5 * DIAMETER))
    expected = (part.entry_rad, wall) if milling == "conventional" else (np.pi - wall, part.exit_rad)
    np.testing.assert_allclose([bent.entry_rad, bent.exit_rad], expected, atol=1e-9)


def test_compliance_is_concave_in_load_and_spares_the_slot():
    soft = effect_class("static_compliance")(1e-5)
    widths = np.array([0.0004, 0.0008, 0.0016, 0.0032])
    load = [float(bent_by(1e-5, cut(axial_width_m=w))[1][0]) for w in widths]
    slope = np.diff(np.abs(load)) / np.diff(widths)
    assert np.all(np.diff(slope) < 0.0) and np.all(slope > 0.0)
    slot = cut("slot")
    np.testing.assert_allclose(
        wave_of(model(soft), slot, 240), wave_of(model(), slot, 240), rtol=1e-12, atol=1e-12
    )


def test_compliance_has_the_slope_of_the_implicit_function():
    def depth(compliance: Any) -> Any:
        return bent_by(compliance, cut())[0].radial_depth_m

    slope = jax.grad(depth)(1e-5)
    difference = (depth(1e-5 + 1e-9) - depth(1e-5 - 1e-9)) / 2e-9
    np.testing.assert_allclose(slope, difference, rtol=1e-5)


def test_a_very_soft_arm_hardly_cuts_and_nothing_breaks():
    soft = effect_class("static_compliance")(2e-3)
    bent, _ = bent_by(2e-3, cut())
    assert 0.0 < float(bent.radial_depth_m) < 1e-4
    nothing, _ = bent_by(2e-3, cut(depth=0.0))
    assert float(nothing.radial_depth_m) == 0.0
    assert np.abs(np.asarray(wave_of(model(soft), cut(depth=0.0), 60))).max() == 0.0


def test_robot_mode_changes_lines_along_one_direction_at_a_fixed_frequency():
    """Gain 1 + mu r^2 / (1 - r^2 + 2 j zeta r) along u; across it nothing; at rest nothing."""
    mode = effect_class("robot_mode")(0.5, 38.0, 0.05, 0.6)
    along, across = np.array([np.cos(0.6), np.sin(0.6), 0]), np.array([-np.sin(0.6), np.cos(0.6), 0])
    runout = effect_class("radial_runout")(1e-5, 0.0)
    for speed in (12.0, 19.0, 38.0):
        here = cut(spindle_speed_rev_s=speed, feed_speed_m_s=0.0125 * speed / SPEED)
        with_, without = (np.asarray(lines_of(m, here, 4, 400)) for m in (model(runout, mode), model(runout)))
        r = np.arange(5) * speed / 38.0
        gain = 1.0 + 0.5 * r**2 / (1.0 - r**2 + 0.1j * r)
        np.testing.assert_allclose(with_ @ along, gain * (without @ along), atol=1e-9)
        np.testing.assert_allclose(with_ @ across, without @ across, atol=1e-9)


def test_robot_mode_rings_at_entry():
    """A step of force is felt at once as 1 - mu of itself, the rest speeds the tool up; then it rings."""
    mode = effect_class("robot_mode")(0.5, 25.0, 0.05, 0.0)
    rate = 2000.0
    time = np.arange(2000) / rate
    still = cut().replace(angle_rad=np.full(2000, 0.2), time_s=time)
    seen = np.asarray(predict(model(mode), still, 1 / rate))[:, 0]
    force = float(model().process_force(cut(angle_rad=0.2))[0])
    assert force < 0.0
    assert seen[-1] == pytest.approx(force, rel=1e-2)
    ring = seen - force
    assert ring[0] == pytest.approx(-0.5 * force, rel=0.05)
    spectrum = np.abs(np.fft.rfft(ring * np.exp(-time)))
    assert np.argmax(spectrum) == pytest.approx(25.0, abs=1.5)


@pytest.mark.parametrize(
    ("gradient", "curvature", "expected"), [(3.0, 0.0, [60.0, 78.0, 96.0]), (-6.0, 30.0, [60.0, 42.0, 60.0])]
)
def test_clamp_mode_moves_along_the_path_on_the_normal_axis(gradient, curvature, expected):
    mode = effect_class("clamp_mode")(0.5, 60.0, gradient, 0.02, curvature)
    frequency = jnp.linspace(20.0, 150.0, 1301)
    peaks = []
    for position in (0.0, 0.1, 0.2):
        gain = np.asarray(mode.transfer(frequency, cut(position_m=position), model()))
        np.testing.assert_allclose(gain[:, 0, 0], 1.0)
        np.testing.assert_allclose(gain[:, 0, 1], 0.0)
        peaks.append(float(frequency[np.argmax(np.abs(gain[:, 1, 1]))]))
    np.testing.assert_allclose(peaks, expected, atol=1.0)


def test_a_plate_on_a_dynamometer_shows_its_spring_and_damper():
    """At mass ratio 1 the gain is (1 + 2 j zeta r) / (1 - r^2 + 2 j zeta r), the transmissibility."""
    mode = effect_class("clamp_mode")(1.0, 60.0, 0.0, 0.03)
    frequency = np.array([0.0, 30.0, 60.0, 200.0])
    r = frequency / 60.0
    expected = (1 + 0.06j * r) / (1 - r**2 + 0.06j * r)
    np.testing.assert_allclose(mode.transfer(frequency, cut(), model())[:, 1, 1], expected, rtol=1e-12)


def test_joint_friction_flips_where_the_joint_reverses():
    friction = effect_class("joint_friction")(6.0, 20.0)
    velocity = np.array([-0.2, -0.1, 0.0, 0.1, 0.2])
    here = cut().replace(angle_rad=np.zeros(5), joint_velocity_rad_s=velocity)
    seen = np.asarray(model(friction).sense(jnp.zeros((5, 3)), here))
    np.testing.assert_allclose(seen[:, 0], [10.0, 8.0, 0.0, -8.0, -10.0], atol=1e-9)
    np.testing.assert_array_equal(seen[:, 1:], 0.0)


def loop(rate_hz: float, stiction: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Position and force of one closed stroke of 1 mm at the given rate, in air."""
    friction = effect_class("hysteresis")(8.0, 5e-5, stiction, 0.0)
    steps = 2000
    phase = 2 * np.pi * np.arange(3 * steps) / steps
    speed = 2 * np.pi * rate_hz * 5e-4 * np.cos(phase)
    air = cut(depth=0.0).replace(angle_rad=np.zeros(3 * steps), feed_speed_m_s=speed)
    force = np.asarray(predict(model(friction), air, 1.0 / (rate_hz * steps)))[:, 0]
    return 5e-4 * np.sin(phase[-steps:]), force[-steps:]


def test_hysteresis_is_a_loop_that_does_not_depend_on_the_rate():
    position, slow = loop(0.2)
    _, fast = loop(20.0)
    np.testing.assert_allclose(fast, slow, atol=1e-9)
    np.testing.assert_allclose([slow.min(), slow.max()], [-8.0, 8.0], rtol=1e-3)
    width = abs(np.trapezoid(slow, position))
    assert 0.8 * 16.0 * 1e-3 < width <= 16.0 * 1e-3


def test_hysteresis_slides_and_sticks():
    _, plain = loop(0.05)
    _, sticking = loop(0.05, stiction=1.5)
    assert np.abs(sticking).max() > 1.2 * np.abs(plain).max()
