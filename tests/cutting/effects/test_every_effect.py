"""What every registered effect must keep, whatever it does: one test over all names."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.cutting import (
    AbstractEffect,
    Cut,
    ForceModel,
    Material,
    Tool,
    effect_class,
    effect_names,
    order_lines,
)

NAMES = effect_names()
COUPLED = [name for name in NAMES if effect_class(name).coupled]
TOOL = Tool("slitting_saw", 6, 0.05)
MATERIAL = Material.from_n_mm(900.0, 20.0, 300.0, 12.0, 60.0, 3.0)
SPEED, FEED = 20.0, 0.006
STEPS_PER_TURN, SAMPLES = 60, 4
DT = 1.0 / (SPEED * STEPS_PER_TURN)


def example(name: str) -> AbstractEffect:
    """An instance of plain size: the first starting point of its fit, unless that dies away too slowly."""
    quick = {
        "robot_mode": (0.4, 90.0, 0.2, 0.6),
        "sensor_resonance": (200.0, 0.2),
        "regenerative_chatter": ([2e-8, 1e-8], [300.0, 400.0], [0.1, 0.1]),
        "flank_wear": ([1e9, 2e9, 5e8], 1e-6, 1e-5, 0.5, 1e-6, 2.0),
    }
    if name in quick:
        return effect_class(name)(*(jnp.asarray(value) for value in quick[name]))
    kind = effect_class(name)
    return kind.build(jnp.asarray(kind.starts(TOOL)[0], dtype=float), TOOL)


def identity(name: str) -> AbstractEffect:
    """The identity as arrays, so that it runs through the same compiled program."""
    return jax.tree.map(lambda value: jnp.asarray(value, dtype=float), effect_class(name).identity(TOOL))


def conditions(**change: Any) -> Cut:
    """A cut in which every covariate is away from zero."""
    given = {
        "angle_rad": 0.0,
        "spindle_speed_rev_s": SPEED,
        "feed_speed_m_s": FEED,
        "radial_depth_m": 0.006,
        "axial_width_m": 0.0016,
        "position_m": 0.01,
        "cut_length_m": 3.0,
        "time_s": 0.0,
        "clock_s": 400.0,
        "vibration_x_m_s": 0.002,
        "vibration_y_m_s": -0.003,
        "gravity_x_m_s2": 1.0,
        "gravity_y_m_s2": 9.0,
        "gravity_z_m_s2": -2.0,
        "joint_velocity_rad_s": 0.05,
        "feed_deviation_m_s": 0.0004,
        **change,
    }
    return Cut.milling("conventional", 0.05, **given)


def model(*effects: AbstractEffect) -> ForceModel:
    return ForceModel(TOOL, MATERIAL, effects)


def record(steps: int) -> Cut:
    """Instants in the middle of every sample of `steps` sub-steps, as `step` takes them."""
    time = (jnp.arange(steps * SAMPLES) + 0.5) * DT / SAMPLES
    return conditions(gate_rad=2.0 * np.pi / (STEPS_PER_TURN * SAMPLES)).replace(
        angle_rad=2.0 * jnp.pi * SPEED * time,
        time_s=time,
        clock_s=400.0 + time,
        position_m=0.01 + FEED * time,
        cut_length_m=3.0 + FEED * time,
    )


@jax.jit
def predicted(the_model: ForceModel) -> jax.Array:
    """[steps, 3] means over each sub-step of half a revolution."""
    steps = STEPS_PER_TURN // 2
    return the_model.predict(record(steps), DT / SAMPLES).reshape(steps, SAMPLES, 3).mean(axis=1)


@jax.jit
def stepped(the_model: ForceModel) -> jax.Array:
    """[steps, 3] the same half revolution by one sub-step after another."""

    def one(state: Any, index: Any) -> Any:
        time = DT * index
        here = conditions(
            angle_rad=2.0 * jnp.pi * SPEED * time,
            time_s=time,
            clock_s=400.0 + time,
            position_m=0.01 + FEED * time,
            cut_length_m=3.0 + FEED * time,
        )
        state, _, sensed = the_model.step(state, here, DT, SAMPLES)
        return state, sensed

    return jax.lax.scan(one, the_model.init(), jnp.arange(STEPS_PER_TURN // 2))[1]


@pytest.mark.parametrize("name", NAMES)
def test_what_it_declares(name: str):
    kind = effect_class(name)
    fields = [field.name for field in dataclasses.fields(kind)]
    assert fields[: len(kind.parameters)] == list(kind.parameters), "fields and parameters in one order"
    assert kind.signature and kind.confused_with
    assert kind.__doc__ and all(f"`{field}`" in kind.__doc__ for field in kind.parameters)
    for parameter in kind.parameters.values():
        assert parameter.unit and parameter.low < parameter.high
        if parameter.identity is not None and not parameter.log:
            # below the range where an effect is all or nothing, as a tooth that is broken or is not
            assert parameter.identity <= parameter.high
    starts = kind.starts(TOOL)
    assert starts.shape[1:] == (kind.size(TOOL),) and len(starts) >= 1
    assert np.all(np.abs(starts) <= 10.0), "coordinates of order one"
    for start in starts:
        values = kind.build(jnp.asarray(start), TOOL).values()
        assert set(values) == set(kind.parameters)
        for parameter_name, parameter in kind.parameters.items():
            value = np.asarray(values[parameter_name])
            assert value.shape == parameter.shape(TOOL)
            assert np.all((value >= parameter.low) & (value <= parameter.high)), parameter_name


@pytest.mark.parametrize("name", NAMES)
def test_one_object_serves_record_and_steps(name: str, float64: None):
    """`predict` over a record and `step` one sub-step after another are the same; and it does something."""
    sensed = predicted(model(example(name)))
    np.testing.assert_allclose(stepped(model(example(name))), sensed, rtol=1e-8, atol=1e-8)
    difference = np.abs(np.asarray(sensed - predicted(model())))
    assert np.isfinite(difference).all()
    assert difference.max() > 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_identity_leaves_the_force_as_it_was(name: str, float64: None):
    bare = predicted(model())
    kind = effect_class(name)
    still = [identity(name)]
    if not kind.parameters[kind.strength].log:
        still.append(kind.build(jnp.zeros(kind.size(TOOL)), TOOL))
    for effect in still:
        np.testing.assert_allclose(predicted(model(effect)), bare, rtol=1e-7, atol=1e-6)


def test_all_identities_together_leave_force_and_torque(float64: None):
    here = conditions(angle_rad=0.1)
    still = model(*(identity(name) for name in NAMES))
    torque = jax.jit(ForceModel.torque_z)(still, here)
    np.testing.assert_allclose(torque, model().torque_z(here), rtol=1e-9)
    np.testing.assert_allclose(
        jax.jit(ForceModel.process_force)(still, here), model().process_force(here), rtol=1e-9
    )


@pytest.mark.parametrize("name", [name for name in NAMES if effect_class(name).steady])
def test_order_lines_are_the_record_of_a_steady_cut(name: str, float64: None):
    """Conditions held, start died away: the last revolution is the sum of the lines, to 1 % of the peak."""
    the_model = model(example(name))
    turns, angles = 8, 960
    time = jnp.arange(turns * angles) / (SPEED * angles)
    fine = conditions(gate_rad=2.0 * np.pi / angles).replace(angle_rad=2.0 * jnp.pi * SPEED * time)
    wave = np.asarray(jax.jit(ForceModel.predict)(the_model, fine, 1.0 / (SPEED * angles)))[-angles:]
    orders = 60
    lines = np.asarray(jax.jit(order_lines, static_argnums=(2, 3))(the_model, conditions(), orders, angles))
    measured = np.fft.rfft(wave, axis=0)[: orders + 1] / angles
    if name == "spindle_droop":  # the record lags more and more behind the nominal angle: sizes only
        measured, lines = np.abs(measured[:1]), np.abs(lines[:1])
    np.testing.assert_allclose(measured, lines, atol=0.01 * np.abs(wave).max())


@pytest.mark.parametrize("name", [name for name in NAMES if effect_class(name).alike])
def test_lines_found_from_one_tooth_are_those_of_all(name: str, float64: None, monkeypatch):
    def lines() -> np.ndarray:
        return np.asarray(order_lines(model(example(name)), conditions(), 60, 960))

    one = lines()
    monkeypatch.setattr(effect_class(name), "alike", False)
    np.testing.assert_allclose(one, lines(), atol=1e-12 * np.abs(one).max())


@pytest.mark.parametrize("name", NAMES)
def test_file_and_back(name: str):
    the_model = model(example(name))
    again = ForceModel.from_dict(json.loads(json.dumps(the_model.to_dict(), allow_nan=False)))
    for key, value in the_model.effects[0].values().items():
        np.testing.assert_allclose(again.effects[0].values()[key], value, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_gradient_in_every_coordinate(name: str, float64: None):
    """Slopes of the record in the fit's coordinates, against finite differences; rounded ones are flat."""
    kind = effect_class(name)
    start = jnp.asarray(kind.starts(TOOL)[0], dtype=float) + 0.013
    weight = jnp.cos(0.37 * jnp.arange(STEPS_PER_TURN // 2 * 3)).reshape(-1, 3)

    @jax.jit
    def loss(coordinates: jax.Array) -> jax.Array:
        return jnp.sum(weight * predicted(model(kind.build(coordinates, TOOL))))

    slope = np.asarray(jax.jit(jax.grad(loss))(start))
    assert np.isfinite(slope).all()
    step = 1e-5
    difference = np.array(
        [float(loss(start + step * unit) - loss(start - step * unit)) for unit in np.eye(len(start))]
    ) / (2.0 * step)
    np.testing.assert_allclose(slope, difference, rtol=1e-3, atol=1e-4 * np.abs(slope).max())
    assert np.abs(slope).max() > 0.0
    at_identity = np.asarray(jax.jit(jax.grad(loss))(jnp.zeros_like(start)))
    assert np.isfinite(at_identity).all()


PAIRS = [tuple(pair) for pair in np.random.default_rng(3).permuted(np.tile(NAMES, (6, 1)), axis=1)[:, :2]]


@pytest.mark.parametrize("pair", PAIRS, ids="+".join)
def test_pairs_compose(pair: tuple[str, str], float64: None):
    first, second = (example(name) for name in pair)
    both = predicted(model(first, second))
    assert np.isfinite(np.asarray(both)).all()
    np.testing.assert_allclose(stepped(model(first, second)), both, rtol=1e-8, atol=1e-8)
    alone = predicted(model(first))
    with_identity = predicted(model(first, identity(pair[1])))
    np.testing.assert_allclose(with_identity, alone, rtol=1e-6, atol=1e-5)


def test_all_at_once_in_any_order(float64: None):
    effects = [example(name) for name in NAMES]
    forward = predicted(model(*effects))
    assert np.isfinite(np.asarray(forward)).all()
    np.testing.assert_allclose(stepped(model(*effects)), forward, rtol=1e-7, atol=1e-6)
    stages = sorted(effects, key=lambda effect: ForceModel(TOOL, MATERIAL, (effect,)).effects[0].stage)
    np.testing.assert_allclose(predicted(model(*stages)), forward, rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("name", NAMES)
def test_float32_step_of_the_simulation(name: str):
    """jitted and vmapped over parameters, in float32, as the simulation calls it; close to float64."""
    kind = effect_class(name)
    starts = kind.starts(TOOL)
    batch = jnp.asarray(np.stack([starts[0], 0.5 * starts[0]]), dtype=jnp.float32)

    @jax.jit
    @jax.vmap
    def run(coordinates: jax.Array) -> tuple[jax.Array, jax.Array]:
        the_model = model(kind.build(coordinates, TOOL))
        state = the_model.init()
        _, process, sensed = the_model.step(state, conditions(angle_rad=0.1), 0.002)
        return process, sensed

    process, sensed = run(batch)
    assert process.dtype == sensed.dtype == jnp.float32
    with _platform.x64():
        exact = run(jnp.asarray(batch, dtype=float))
    np.testing.assert_allclose(process, exact[0], rtol=2e-3, atol=2e-2)
    np.testing.assert_allclose(sensed, exact[1], rtol=2e-3, atol=2e-2)


@pytest.mark.parametrize("kind", ["drill", "turning"])
def test_all_that_apply_to_other_tools(kind: str, float64: None):
    tool = Tool(kind, 2 if kind == "drill" else 1, 0.01)
    applying = [effect_class(name) for name in NAMES if effect_class(name).size(tool)]
    effects = tuple(each.build(jnp.asarray(each.starts(tool)[0], dtype=float), tool) for each in applying)
    whole = ForceModel(tool, MATERIAL, effects)
    _, process, sensed = jax.jit(ForceModel.step)(whole, whole.init(), conditions(), 0.002)
    assert np.isfinite(np.asarray(process)).all() and np.isfinite(np.asarray(sensed)).all()
    still = ForceModel(tool, MATERIAL, tuple(each.identity(tool) for each in applying))
    np.testing.assert_allclose(
        jax.jit(ForceModel.process_force)(still, conditions()),
        ForceModel(tool, MATERIAL).process_force(conditions()),
        rtol=1e-6,
        atol=1e-9,
    )
