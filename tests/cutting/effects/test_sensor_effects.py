"""Signatures of the effects at the sensor."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import signal

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, effect_class, order_lines

lines_of = jax.jit(order_lines, static_argnums=(2, 3))
force_of = jax.jit(ForceModel.process_force)

pytestmark = pytest.mark.usefixtures("float64")


def model(*effects: Any) -> ForceModel:
    return ForceModel(Tool("end_mill", 2, 0.025), Material.from_n_mm(950, 16, 250, 19, 100, 5), effects)


def slot(speed: float, exit_: float = np.pi) -> Cut:
    return Cut(0.0, speed, 5e-5 * 2 * speed, 0.025, 0.0015, 0.0, exit_)


def gain(effect: Any, speed: float, orders: int = 24) -> np.ndarray:
    """[orders + 1] ratio of every line of the normal force with and without the effect."""
    with_, without = (
        np.abs(np.asarray(lines_of(m, slot(speed), orders, 960)))[:, 1] for m in (model(effect), model())
    )
    return np.where(without > 1e-6, with_ / np.maximum(without, 1e-12), np.nan)


def test_resonance_inflates_lines_at_a_fixed_frequency():
    """The line nearest 400 Hz is the largest gain whatever the speed; the mean is untouched."""
    resonance = effect_class("sensor_resonance")(400.0, 0.05)
    for speed in (20.0, 33.0, 50.0):
        found = gain(resonance, speed)
        tallest = np.nanargmax(found) * speed
        assert abs(tallest - 400.0) <= speed
        assert np.nanmax(found) > 3.0
        assert found[0] == pytest.approx(1.0)
    assert gain(resonance, 50.0)[8] == pytest.approx(1.0 / (2 * 0.05), rel=1e-6)


def test_resonance_along_the_axis_may_be_another():
    """z by twice the frequency and three times the damping; in a record each axis swings at its own."""
    alike, apart = (effect_class("sensor_resonance")(200.0, 0.05, *own) for own in ((), (2.0, 3.0)))
    frequency = np.array([0.0, 100.0, 200.0, 400.0])
    one, other = (np.asarray(each.transfer(frequency, slot(20.0), model())) for each in (alike, apart))
    np.testing.assert_allclose(other[:, :2, :2], one[:, :2, :2])
    own = 1.0 / (1.0 - (frequency / 400.0) ** 2 + 2.0j * 0.15 * frequency / 400.0)
    np.testing.assert_allclose(other[:, 2, 2], own, rtol=1e-12)
    assert not other[:, 2, :2].any() and not other[:, :2, 2].any()
    time = np.arange(4000) / 8000.0
    still = slot(20.0).replace(angle_rad=np.full(4000, 1.0), time_s=time)
    sensed = np.asarray(jax.jit(ForceModel.predict)(model(apart), still, 1 / 8000.0))
    swing = np.abs(np.fft.rfft(sensed - sensed[-1], axis=0))
    assert np.argmax(swing, axis=0) / 0.5 == pytest.approx([200.0, 200.0, 400.0], abs=4.0)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_lowpass_is_a_butterworth(order: int):
    """Against SciPy's analogue filter, and a loss at a fixed frequency whatever the speed; the mean exact."""
    lowpass = effect_class("sensor_lowpass")(80.0, float(order))
    frequency = np.array([0.0, 20.0, 80.0, 160.0, 400.0])
    b, a = signal.butter(order, 2 * np.pi * 80.0, analog=True)
    expected = signal.freqs(b, a, 2 * np.pi * frequency)[1]
    found = np.asarray(lowpass.transfer(frequency, slot(20.0), model()))
    np.testing.assert_allclose(found, expected[:, None, None] * np.eye(3), atol=1e-12)
    for speed in (20.0, 40.0):
        assert gain(lowpass, speed)[int(80 / speed)] == pytest.approx(np.sqrt(0.5), rel=1e-6)
        assert gain(lowpass, speed)[0] == pytest.approx(1.0)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_a_lowpass_is_tried_again_with_every_other_order(order: int):
    kind, tool = effect_class("sensor_lowpass"), model().tool
    again = kind.again(np.array([np.log(2.0), 0.5 * order]), tool)
    filters = [kind.build(jnp.asarray(each), tool) for each in again]
    assert sorted({float(each.order) for each in filters}) == [n for n in (1, 2, 3, 4) if n != order]
    for each in filters:
        cutoff = float(each.cutoff_hz)
        assert cutoff == pytest.approx(200.0) or (cutoff < 200.0) == (float(each.order) < order)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_lowpass_in_a_record_settles_to_the_mean(order: int):
    the_model = model(effect_class("sensor_lowpass")(60.0, float(order)))
    time = np.arange(1000) / 5000.0
    still = slot(20.0).replace(angle_rad=np.full(1000, 1.0), time_s=time)
    sensed = np.asarray(jax.jit(ForceModel.predict)(the_model, still, 1 / 5000.0))
    target = np.asarray(force_of(model(), slot(20.0).replace(angle_rad=1.0)))
    np.testing.assert_allclose(sensed[-1], target, rtol=1e-6)
    assert np.all(np.abs(sensed[0]) < 0.2 * np.abs(target))
    if order >= 2:
        assert np.max(sensed[:, 1] / target[1]) > 1.02


def test_crosstalk_is_a_scaled_copy_with_the_mean():
    coupling = np.array([0.01, -0.02, 0.03, 0.005, -0.01, 0.02])
    plain = np.asarray(lines_of(model(), slot(20.0), 12, 480))
    mixed = np.asarray(lines_of(model(effect_class("crosstalk")(coupling)), slot(20.0), 12, 480))
    xy, xz, yx, yz, zx, zy = coupling
    matrix = np.array([[1, xy, xz], [yx, 1, yz], [zx, zy, 1]])
    np.testing.assert_allclose(mixed, plain @ matrix.T, atol=1e-9)


def test_crosstalk_comes_after_a_mode_of_the_arm():
    """Structure before sensor, whatever the order in which the effects are given: time and lines agree."""
    mode = effect_class("robot_mode")(0.6, 90.0, 0.2, 0.0)
    mixing = effect_class("crosstalk")(np.array([0.0, 0.0, 0.2, 0.0, 0.0, 0.0]))
    one = np.asarray(lines_of(model(mode, mixing), slot(20.0), 12, 480))
    other = np.asarray(lines_of(model(mixing, mode), slot(20.0), 12, 480))
    np.testing.assert_allclose(one, other, atol=1e-9)
    alone = np.asarray(lines_of(model(mode), slot(20.0), 12, 480))
    np.testing.assert_allclose(one[:, 1], alone[:, 1] + 0.2 * alone[:, 0], atol=1e-9)


def test_tool_gravity_follows_the_pose_and_shows_in_air():
    weight = effect_class("tool_gravity")(1.5)
    air = slot(20.0, exit_=0.0)
    for pose in ([0.0, 0.0, -9.81], [0.0, 9.81, 0.0], [3.0, 0.0, -9.81]):
        here = air.replace(gravity_x_m_s2=pose[0], gravity_y_m_s2=pose[1], gravity_z_m_s2=pose[2])
        force = force_of(model(weight), here)
        np.testing.assert_allclose(force, 0.0, atol=1e-12)
        np.testing.assert_allclose(model(weight).sense(force, here), 1.5 * np.array(pose), rtol=1e-12)


def test_thermal_drift_runs_with_the_clock_only():
    """b (exp(-t0/tau) - exp(-t/tau)) with t0 the zeroing; cut length does not matter, nor does the cut."""
    drift = effect_class("thermal_drift")(np.array([2.0, -1.0, 3.0]), 600.0)
    clock = np.array([0.0, 300.0, 600.0, 3600.0])
    air = slot(20.0, exit_=0.0).replace(angle_rad=np.zeros(4), clock_s=clock, cut_length_m=np.arange(4.0))
    seen = np.asarray(model(drift).sense(np.zeros((4, 3)), air))
    b, tau, t0 = 7.0, 600.0, 200.0
    equation = b * (np.exp(-t0 / tau) - np.exp(-(t0 + clock) / tau))
    np.testing.assert_allclose(seen[:, 0] / 2.0, equation / (b * np.exp(-t0 / tau)), atol=1e-12)
    np.testing.assert_allclose(seen[:, 1:], np.outer(seen[:, 0] / 2.0, [-1.0, 3.0]), atol=1e-12)


def test_time_offset_shifts_the_record_and_turns_the_lines():
    delay, rate = 0.006, 4000.0
    offset = effect_class("time_offset")(delay)
    angle = 2 * np.pi * 20.0 * np.arange(2000) / rate
    record = slot(20.0).replace(angle_rad=angle)
    late = np.asarray(jax.jit(ForceModel.predict)(model(offset), record, 1 / rate))
    plain = np.asarray(jax.jit(ForceModel.predict)(model(), record, 1 / rate))
    steps = int(delay * rate)
    np.testing.assert_allclose(late[steps + 1 :], plain[1:-steps], atol=1e-9)
    assert gain(offset, 20.0)[[0, 2, 4]] == pytest.approx(1.0)
    lines = np.asarray(lines_of(model(offset), slot(20.0), 4, 480))[2, 1]
    bare = np.asarray(lines_of(model(), slot(20.0), 4, 480))[2, 1]
    np.testing.assert_allclose(lines / bare, np.exp(-2j * np.pi * 40.0 * delay), rtol=1e-9)


def test_a_delay_beyond_the_memory_is_not_answered_wrongly():
    offset = effect_class("time_offset")(0.05)
    record = slot(20.0).replace(angle_rad=np.linspace(0, 1, 50))
    assert np.isnan(np.asarray(model(offset).predict(record, 1e-5))).all()


def test_mains_is_there_in_air_at_its_frequency():
    mains = effect_class("mains_pickup")(np.array([1.0, 0.5, 0.0]), np.array([0.0, 1.0, 0.0]), 50.0)
    time = np.arange(1000) / 1000.0
    air = slot(20.0, exit_=0.0).replace(angle_rad=2 * np.pi * 20.0 * time, time_s=time)
    seen = np.asarray(jax.jit(ForceModel.predict)(model(mains), air, 1e-3))
    spectrum = np.abs(np.fft.rfft(seen, axis=0)) / 500.0
    np.testing.assert_allclose(spectrum[50], [1.0, 0.5, 0.0], atol=1e-9)
    spectrum[50] = 0.0
    assert spectrum.max() < 1e-9
