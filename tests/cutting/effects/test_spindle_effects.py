"""Signatures of the effects at the spindle."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, effect_class, order_lines
from mjx_cutting.cutting.average import mean_load

pytestmark = pytest.mark.usefixtures("float64")

SPEED = 30.0
MATERIAL = Material.from_n_mm(900.0, 20.0, 300.0, 12.0, 60.0, 3.0)
lines_of = jax.jit(order_lines, static_argnums=(2, 3))


def model(*effects: Any, teeth: int = 4, material: Material = MATERIAL) -> ForceModel:
    return ForceModel(Tool("end_mill", teeth, 0.02), material, effects)


def cut(**change: Any) -> Cut:
    given = {
        "angle_rad": 0.0,
        "spindle_speed_rev_s": SPEED,
        "feed_speed_m_s": 0.006,
        "radial_depth_m": 0.006,
        "axial_width_m": 0.002,
        **change,
    }
    return Cut.milling("conventional", 0.02, **given)


def test_droop_solves_its_own_equation():
    """f = f0 - T(f) / k with the mean torque at the speed under load."""
    droop = effect_class("spindle_droop")(3.0)
    speed = droop.loaded_speed_rev_s(cut(), model())
    load = mean_load(model(), cut(spindle_speed_rev_s=speed))
    np.testing.assert_allclose(speed, SPEED - 3.0 * (load.chip_torque + load.edge_torque), rtol=1e-9)
    assert 0.5 < float(speed) / SPEED < 0.99


def test_droop_raises_the_mean_with_load_and_not_in_air():
    droop = effect_class("spindle_droop")(3.0)
    gains = []
    for feed in (0.003, 0.012):
        with_, without = (
            abs(complex(lines_of(m, cut(feed_speed_m_s=feed), 4, 240)[0, 0])) for m in (model(droop), model())
        )
        gains.append(with_ / without)
    assert 1.0 < gains[0] < gains[1]
    air = cut(radial_depth_m=0.0)
    np.testing.assert_allclose(droop.loaded_speed_rev_s(air, model()), SPEED, rtol=1e-6)


def test_droop_shifts_the_lines_of_a_record():
    """The tooth-passing line stands at the speed under load, not at the nominal one."""
    droop = effect_class("spindle_droop")(3.0)
    loaded = float(droop.loaded_speed_rev_s(cut(), model()))
    rate, seconds = 3000.0, 2.0
    time = jnp.arange(int(rate * seconds)) / rate
    record = cut(gate_rad=2 * np.pi * SPEED / rate).replace(angle_rad=2 * jnp.pi * SPEED * time, time_s=time)
    force = np.asarray(jax.jit(ForceModel.predict)(model(droop), record, 1.0 / rate))[:, 0]
    spectrum = np.abs(np.fft.rfft(force - force.mean()))
    peak = np.argmax(spectrum) / seconds
    assert abs(peak - 4 * loaded) < 1.0
    assert abs(peak - 4 * SPEED) > 5.0


def _left_of_a_record(line_droop: Any, record_droop: Any, teeth: int) -> float:
    """Share of a settled record's lines that the lines of a model leave, phase and speed as the record's."""
    rate, turns = 400.0 * SPEED, 16
    angle = 2.0 * jnp.pi * SPEED / rate * jnp.arange(int(turns * rate / SPEED))
    record = cut(gate_rad=2.0 * np.pi * SPEED / rate).replace(angle_rad=angle)
    force = np.asarray(jax.jit(ForceModel.predict)(model(record_droop, teeth=teeth), record, 1.0 / rate))
    force, time = force[len(force) // 4 :, :2], np.arange(len(force))[len(force) // 4 :] / rate
    lines = np.asarray(lines_of(model(line_droop, teeth=teeth), cut(), 4 * teeth, 960))
    passing = teeth * np.arange(1, 5)
    about = float(line_droop.loaded_speed_rev_s(cut(), model(teeth=teeth)))

    def read(speed: float) -> np.ndarray:
        wave = np.exp(1j * np.outer(2.0 * np.pi * speed * time, passing))
        columns = np.concatenate([np.ones((len(time), 1)), wave.real, wave.imag], axis=1)
        found = np.linalg.lstsq(columns, force, rcond=None)[0]
        return 0.5 * (found[1:5] - 1j * found[5:])

    speeds = about * (1.0 + np.linspace(-0.01, 0.01, 401))
    own = read(max(speeds, key=lambda speed: float(np.sum(np.abs(read(speed)) ** 2))))
    phases = np.exp(1j * np.outer(np.linspace(0.0, 2.0 * np.pi / teeth, 2000), passing))
    left = [np.sum(np.abs(own - each[:, None] * lines[passing, :2]) ** 2) for each in phases]
    return float(np.sqrt(min(left) / np.sum(np.abs(own) ** 2)))


@pytest.mark.parametrize("bandwidth_hz", [1e5, 150.0])
def test_a_motor_of_little_inertia_draws_out_its_lines_in_a_record_as_in_the_order_domain(bandwidth_hz):
    """Teeth that cut a short arc load the motor by turns: the lines are those of a record stepped in time."""
    swings, steady = (effect_class("spindle_droop")(1.5, each) for each in (bandwidth_hz, 0.0))
    follows = _left_of_a_record(swings, swings, teeth=2)
    evenly = _left_of_a_record(steady, swings, teeth=2)
    assert follows < 0.15 * evenly and evenly > 0.03
    assert _left_of_a_record(steady, steady, teeth=2) < 0.004


def test_a_motor_that_follows_the_mean_alone_is_the_limit_of_no_bandwidth_and_has_a_slope():
    steady = np.asarray(lines_of(model(effect_class("spindle_droop")(1.5)), cut(), 16, 960))

    def line(bandwidth_hz: Any) -> Any:
        droop = effect_class("spindle_droop")(1.5, bandwidth_hz)
        return order_lines(model(droop), cut(), 16, 960)

    np.testing.assert_allclose(jax.jit(line)(0.0), steady, rtol=1e-9, atol=1e-9)
    slope = jax.grad(lambda bandwidth_hz: jnp.abs(line(bandwidth_hz)[4, 1]))
    near, there = (float(jax.jit(slope)(each)) for each in (0.0, 100.0))
    assert np.isfinite(near) and there != 0.0
    rise = (jnp.abs(line(100.1)[4, 1]) - jnp.abs(line(99.9)[4, 1])) / 0.2
    np.testing.assert_allclose(there, rise, rtol=1e-4)


def test_teeth_that_differ_take_chips_by_the_time_since_the_tooth_before():
    """A tooth that reaches far slows the motor, so what comes behind it takes more."""
    runout = effect_class("radial_runout")(2e-5, 0.0)
    given = cut(feed_speed_m_s=0.012)
    with_, without = (
        np.abs(np.asarray(lines_of(model(runout, each), given, 8, 960))[1, 1])
        for each in (effect_class("spindle_droop")(3.0, 1e5), effect_class("spindle_droop")(3.0))
    )
    assert abs(with_ / without - 1.0) > 0.02


def test_a_stalling_motor_stays_finite():
    droop = effect_class("spindle_droop")(1e4)
    speed = droop.loaded_speed_rev_s(cut(), model())
    assert 0.0 < float(speed) < SPEED
    slope = jax.grad(lambda d: effect_class("spindle_droop")(d).loaded_speed_rev_s(cut(), model()))(1e4)
    assert np.isfinite(slope)


def test_ripple_leaves_lines_at_its_order():
    """Order 3 on four teeth: lines at 3 and at its neighbours of tooth passing, proportional to eps."""
    kind = effect_class("torque_ripple")
    bare = np.abs(np.asarray(lines_of(model(), cut(), 12, 960)))
    found = [
        np.abs(np.asarray(lines_of(model(kind(eps, 3.0, 0.4)), cut(), 12, 960))) for eps in (0.005, 0.01)
    ]
    assert bare[3].max() < 1e-3 * bare[4].max()
    assert found[0][3].max() > 5e-4 * bare[4].max()
    np.testing.assert_allclose(found[1][3] / found[0][3], 2.0, rtol=0.02)


def test_ripple_in_step_with_the_teeth_leaves_the_chips_alone():
    """At p = N every tooth meets the same speed: the chip follows the mean, only the angle moves."""
    ripple = effect_class("torque_ripple")(0.02, 4.0, 0.0)
    angle = jnp.linspace(0.0, 6.0, 50)
    here = cut().replace(angle_rad=angle)
    chip = model(ripple).chip(here)
    np.testing.assert_allclose(chip.thickness_m, model().chip(here).thickness_m, atol=1e-15)


def test_ripple_chip_is_the_time_since_the_tooth_before():
    """Against the exact time between passings, by quadrature of 1 / f over the angle."""
    eps, order, phase = 0.01, 2.0, 0.3
    the_model = model(effect_class("torque_ripple")(eps, order, phase), teeth=3)
    angle = 1.1
    fine = np.linspace(angle - 2 * np.pi / 3, angle, 20001)
    pace = 1.0 / (1.0 + eps * np.cos(order * fine + phase))
    time = np.trapezoid(pace, fine) / np.mean(
        1.0 / (1.0 + eps * np.cos(order * np.linspace(0, 2 * np.pi, 20001)[:-1] + phase))
    )
    chip = the_model.chip(cut(angle_rad=angle)).thickness_m[0, 0]
    expected = 0.006 / SPEED * time / (2 * np.pi) * np.sin(angle)
    np.testing.assert_allclose(chip, expected, rtol=3 * eps**2)


def stair_record(effect: Any) -> tuple[np.ndarray, float]:
    rate, seconds = 1000.0, 4.0
    time = np.arange(int(rate * seconds)) / rate
    noise = np.random.default_rng(0).normal(size=time.size) * 0.0004
    record = cut(gate_rad=2 * np.pi * SPEED / rate).replace(
        angle_rad=2 * np.pi * SPEED * time, time_s=time, feed_deviation_m_s=noise
    )
    with_, without = (
        np.asarray(jax.jit(ForceModel.predict)(m, record, 1.0 / rate)) for m in (model(effect), model())
    )
    held = noise.reshape(-1, 20)[:, 0].repeat(20)
    return np.stack([with_[:, 0] - without[:, 0], held, noise], axis=1), rate


def test_command_stair_holds_the_feed_over_each_period():
    """Divided by the wave of a unit of feed the residual is the held deviation, sample by sample."""
    found, _ = stair_record(effect_class("command_stair")(1.0, 0.02))
    unit, _ = stair_record(effect_class("command_stair")(0.5, 0.02))
    np.testing.assert_allclose(found[:, 0], 2.0 * unit[:, 0], atol=1e-6)
    large = np.abs(found[:, 0]) > 0.2 * np.abs(found[:, 0]).max()
    same_sign = np.sign(found[large, 0]) == -np.sign(found[large, 1])
    assert same_sign.mean() > 0.99


def test_command_stair_has_nulls_at_the_policy_rate():
    """The held feed is empty at 50 Hz and its multiples; the force carries it on a wave of chip per feed."""
    found, rate = stair_record(effect_class("command_stair")(1.0, 0.02))
    spectrum = np.abs(np.fft.rfft(found[:, 1]))
    frequency = np.fft.rfftfreq(len(found), 1.0 / rate)

    def level(hz: float) -> float:
        return float(np.sqrt(np.mean(spectrum[np.abs(frequency - hz) < 0.3] ** 2)))

    assert level(50.0) < 0.05 * level(25.0)
    assert level(100.0) < 0.05 * level(25.0)


def test_a_search_for_ripple_starts_at_every_order_of_poles_and_slots():
    """A whole number has no slope, so what is not a start is never found."""
    tool = Tool("slitting_saw", 18, 0.063)
    kind = effect_class("torque_ripple")
    orders = [float(kind.build(np.asarray(x), tool).order) for x in kind.starts(tool)]
    assert orders == list(range(2, 15))
