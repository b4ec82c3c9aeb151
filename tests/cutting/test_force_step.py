"""One force path, three callers: a whole record, order lines, and one simulation sub-step after another."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, effect_class, order_lines, revolution

wave_of = jax.jit(revolution, static_argnums=2)
lines_of = jax.jit(order_lines, static_argnums=(2, 3))

pytestmark = pytest.mark.usefixtures("float64")

SPEED, TEETH = 25.0, 4
STEPS_PER_TURN, SAMPLES = 100, 8
TURNS = 12


def cut(**change: Any) -> Cut:
    given = {
        "angle_rad": 0.0,
        "spindle_speed_rev_s": SPEED,
        "feed_speed_m_s": 0.006,
        "radial_depth_m": 0.005,
        "axial_width_m": 0.002,
        **change,
    }
    return Cut.milling("conventional", 0.02, **given)


def model(*effects: Any) -> ForceModel:
    return ForceModel(Tool("end_mill", TEETH, 0.02), Material.from_n_mm(900, 25, 300, 18, 120, 6), effects)


SETS = {
    "base": (),
    "runout and size effect": (effect_class("radial_runout")(8e-6, 0.5), effect_class("size_effect")(0.25)),
    "resonance": (effect_class("sensor_resonance")(330.0, 0.08),),
    "all": (
        effect_class("sensor_resonance")(330.0, 0.08),
        effect_class("radial_runout")(8e-6, 0.5),
        effect_class("unequal_pitch")(np.array([0.02, -0.01, -0.02, 0.01])),
        effect_class("size_effect")(0.25),
    ),
}


def stepped(the_model: ForceModel, dt: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Process and sensed force of every sub-step, [steps, 3] each."""

    @jax.jit
    def all_steps(the_model: ForceModel) -> Any:
        return jax.lax.scan(partial(one, the_model), the_model.init(), jnp.arange(steps))

    def one(the_model: ForceModel, carry: Any, index: Any) -> Any:
        here = cut(angle_rad=2.0 * np.pi * SPEED * dt * index, time_s=dt * index)
        carry, process, sensed = the_model.step(carry, here, dt, SAMPLES)
        return carry, (process, sensed)

    _, (process, sensed) = all_steps(the_model)
    return np.asarray(process), np.asarray(sensed)


@pytest.mark.parametrize("name", SETS)
def test_steps_equal_a_record(name: str):
    """`step` over many sub-steps is `predict` on the fine grid, averaged over each sub-step."""
    the_model, dt = model(*SETS[name]), 1.0 / (SPEED * STEPS_PER_TURN)
    steps = TURNS * STEPS_PER_TURN
    fine = (np.arange(steps * SAMPLES) + 0.5) * dt / SAMPLES
    record = cut(gate_rad=2.0 * np.pi / (STEPS_PER_TURN * SAMPLES)).replace(
        angle_rad=2.0 * np.pi * SPEED * fine, time_s=fine
    )
    expected = (
        np.asarray(jax.jit(ForceModel.predict)(the_model, record, dt / SAMPLES))
        .reshape(steps, SAMPLES, 3)
        .mean(axis=1)
    )
    _, sensed = stepped(the_model, dt, steps)
    np.testing.assert_allclose(sensed, expected, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", SETS)
def test_steps_equal_order_lines_in_time(name: str):
    """After the start has died away, a record is the sum of its lines: to 0.5 % of the peak."""
    the_model, dt = model(*SETS[name]), 1.0 / (SPEED * STEPS_PER_TURN)
    _, sensed = stepped(the_model, dt, TURNS * STEPS_PER_TURN)
    last = sensed[-STEPS_PER_TURN:]
    lines = np.asarray(lines_of(the_model, cut(), 1599, 3200))
    middle = 2.0 * np.pi * (np.arange(STEPS_PER_TURN) + 0.5) / STEPS_PER_TURN
    order = np.arange(len(lines))
    mean_over_step = np.sinc(order / STEPS_PER_TURN)
    wave = 2.0 * np.real(np.exp(1j * np.outer(middle, order)) @ (lines * mean_over_step[:, None]))
    wave -= np.real(lines[0])
    np.testing.assert_allclose(last, wave, atol=5e-3 * np.abs(wave).max())


def test_process_force_acts_without_the_sensor():
    the_model, dt = model(*SETS["resonance"]), 1.0 / (SPEED * STEPS_PER_TURN)
    process, sensed = stepped(the_model, dt, STEPS_PER_TURN)
    bare, _ = stepped(model(), dt, STEPS_PER_TURN)
    np.testing.assert_allclose(process, bare, rtol=1e-10, atol=1e-10)
    assert np.abs(process - sensed).max() > 0.05 * np.abs(process).max()


def test_mean_over_steps_does_not_depend_on_their_length():
    """Teeth that pass faster than the steps are averaged, not sampled."""
    means = []
    for steps in (10, 100):
        process, _ = stepped(model(), 1.0 / (SPEED * steps), steps)
        means.append(process.mean(axis=0))
    np.testing.assert_allclose(means[0], means[1], rtol=6e-3)
    np.testing.assert_allclose(means[1], wave_of(model(), cut(), 3200).mean(axis=0), rtol=1e-4)


def test_order_lines_are_those_of_a_finely_sampled_turn():
    """The rule over the arc and the revolution at even angles are two ways to the same lines."""
    the_model = model(*SETS["runout and size effect"])
    angles = 28_800
    wave = np.asarray(wave_of(the_model, cut(), angles))
    fine = np.fft.rfft(wave, axis=0)[:32] / angles
    lines = np.asarray(lines_of(the_model, cut(), 31, 64))
    np.testing.assert_allclose(lines, fine, atol=2e-4 * np.abs(wave).max())


def test_order_lines_turn_with_the_start():
    the_model = model(*SETS["runout and size effect"])
    plain = np.asarray(lines_of(the_model, cut(), 12, 240))
    turned = np.asarray(lines_of(the_model, cut(angle_rad=np.pi / 5), 12, 240))
    expected = plain * np.exp(1j * np.arange(13) * np.pi / 5)[:, None]
    np.testing.assert_allclose(turned, expected, atol=1e-9)


def test_lines_over_a_stretch_are_the_mean_of_those_along_it():
    """A clamp mode that moves with the place, behind an arm and a sensor that mixes its axes."""
    effects = (
        effect_class("clamp_mode")(0.5, 90.0, 8.0, 0.03, 20.0),
        effect_class("robot_mode")(0.3, 60.0, 0.05, 0.7),
        effect_class("crosstalk")(0.03 * np.array([1.0, -2.0, 0.5, 1.5, -1.0, 0.7])),
    )
    the_model, places, share = model(*effects), np.array([0.0, 0.01, 0.03]), np.array([0.2, 0.5, 0.3])
    each = [np.asarray(order_lines(the_model, cut(position_m=place), 40, 480)) for place in places]
    over = np.asarray(order_lines(the_model, cut(), 40, 480, along=(places, share)))
    np.testing.assert_allclose(over, np.tensordot(share, each, axes=1), rtol=1e-9, atol=1e-9)
    assert np.abs(each[0] - each[2]).max() > 0.05 * np.abs(over).max()
