"""Gradients against finite differences, jit, vmap and float32: the force path as JAX sees it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, effect_class, revolution
from mjx_cutting.cutting.material import Material as MaterialClass

CONSTANTS = ("K_tc_n_m2", "K_te_n_m", "K_rc_n_m2", "K_re_n_m", "K_ac_n_m2", "K_ae_n_m")


def material() -> MaterialClass:
    return Material.from_n_mm(900.0, 25.0, 300.0, 18.0, 120.0, 6.0)


def four_effects() -> tuple:
    return (
        effect_class("radial_runout")(6e-6, 0.7),
        effect_class("unequal_pitch")(jnp.array([0.01, -0.02, 0.005, 0.005])),
        effect_class("size_effect")(0.2),
        effect_class("sensor_resonance")(420.0, 0.06),
    )


def model(effects: tuple = ()) -> ForceModel:
    return ForceModel(Tool("end_mill", 4, 0.02, 0.4), material(), effects)


def cut(**change: Any) -> Cut:
    given = {
        "angle_rad": 0.3,
        "spindle_speed_rev_s": 40.0,
        "feed_speed_m_s": 0.008,
        "radial_depth_m": 0.004,
        "axial_width_m": 0.003,
        **change,
    }
    return Cut.milling("conventional", 0.02, **given)


def weighed(force: jax.Array) -> jax.Array:
    """A smooth scalar of a wave that no symmetry zeroes."""
    index = jnp.arange(force.shape[0])[:, None] + 7.0 * jnp.arange(3)
    return jnp.sum(force * jnp.cos(0.37 * index)) / force.shape[0]


def check_gradient(function: Callable[[Any], Any], at: float, step: float, rtol: float = 2e-5) -> None:
    function = jax.jit(function)
    slope = float(jax.grad(function)(at))
    difference = float((function(at + step) - function(at - step)) / (2.0 * step))
    assert abs(slope) > 0.0
    np.testing.assert_allclose(slope, difference, rtol=rtol)


@pytest.mark.parametrize("name", CONSTANTS)
def test_gradient_in_each_constant(float64: None, name: str):
    def loss(scale: Any) -> Any:
        base = material()
        changed = Material(**{n: getattr(base, n) * (scale if n == name else 1.0) for n in CONSTANTS})
        return weighed(revolution(ForceModel(model().tool, changed, four_effects()), cut(), 90))

    check_gradient(loss, 1.0, 1e-4)


@pytest.mark.parametrize(
    ("name", "at", "step"),
    [
        ("angle_rad", 0.3, 1e-6),
        ("feed_speed_m_s", 0.008, 1e-7),
        ("spindle_speed_rev_s", 40.0, 1e-4),
        ("axial_width_m", 0.003, 1e-8),
    ],
)
def test_gradient_in_the_conditions(float64: None, name: str, at: float, step: float):
    check_gradient(
        lambda value: weighed(revolution(model(four_effects()), cut(**{name: value}), 90)), at, step
    )


def test_gradient_in_the_depth(float64: None):
    check_gradient(lambda a: weighed(revolution(model(), cut(radial_depth_m=a), 90)), 0.004, 1e-8)


EFFECTS = {
    "offset_m": (lambda v: (effect_class("radial_runout")(v, 0.7),), 6e-6, 1e-11),
    "angle_rad": (lambda v: (effect_class("radial_runout")(6e-6, v),), 0.7, 1e-6),
    "pitch_error_rad": (
        lambda v: (effect_class("unequal_pitch")(jnp.array([v, -0.02, 0.005, 0.005])),),
        0.01,
        1e-7,
    ),
    "exponent": (lambda v: (effect_class("size_effect")(v),), 0.2, 1e-6),
}


@pytest.mark.parametrize("name", EFFECTS)
def test_gradient_in_the_effects(float64: None, name: str):
    build, at, step = EFFECTS[name]
    check_gradient(lambda value: weighed(revolution(model(build(value)), cut(), 90)), at, step)


@pytest.mark.parametrize("level", [0, 1, 3])
def test_gradient_does_not_hang_on_how_it_is_compiled(float64: None, level: int):
    """What is compared with its own least is rounded as it is then, however often it is calculated."""

    def loss(offset_m: Any) -> Any:
        return weighed(revolution(model(EFFECTS["offset_m"][0](offset_m)), cut(), 90))

    compiled = jax.jit(jax.grad(loss), compiler_options={"xla_backend_optimization_level": level})
    np.testing.assert_allclose(compiled(6e-6), jax.grad(loss)(6e-6), rtol=1e-9)


@pytest.mark.parametrize(("index", "at", "step"), [(0, 420.0, 1e-3), (1, 0.06, 1e-6)])
def test_gradient_through_memory(float64: None, index: int, at: float, step: float):
    angle = 2.0 * np.pi * 40.0 * np.arange(100) * 2.5e-4

    def loss(value: Any) -> Any:
        given = [420.0, 0.06]
        given[index] = value
        resonance = effect_class("sensor_resonance")(*given)
        return weighed(model((resonance,)).predict(cut().replace(angle_rad=angle), 2.5e-4))

    check_gradient(loss, at, step)


def test_gradient_is_finite_where_chips_vanish(float64: None):
    """Zero feed, zero depth and a sharp edge of the arc must not make a gradient infinite."""

    def loss(values: tuple[Any, Any, Any]) -> Any:
        feed, depth, exponent = values
        effects = (effect_class("radial_runout")(0.0, 0.0), effect_class("size_effect")(exponent))
        return jnp.sum(revolution(model(effects), cut(feed_speed_m_s=feed, radial_depth_m=depth), 60) ** 2)

    for at in [(0.0, 0.004, 0.1), (0.008, 0.0, 0.1), (0.0, 0.0, 0.0)]:
        assert all(np.isfinite(part) for part in jax.jit(jax.grad(loss))(at))


def test_float32_agrees_with_float64():
    wave_of = jax.jit(revolution, static_argnums=2)
    single = np.asarray(wave_of(model(four_effects()), cut(), 90))
    assert single.dtype == np.float32
    with _platform.x64():
        double = np.asarray(wave_of(model(four_effects()), cut(), 90))
    assert double.dtype == np.float64
    np.testing.assert_allclose(single, double, rtol=0.0, atol=2e-4 * np.abs(double).max())


def test_jit_equals_eager():
    turning = cut().replace(angle_rad=jnp.linspace(0.0, 6.0, 40))
    eager = model(four_effects()).process_force(turning)
    jitted = jax.jit(ForceModel.process_force)(model(four_effects()), turning)
    np.testing.assert_allclose(jitted, eager, rtol=2e-5, atol=2e-3)


def test_vmap_and_broadcasting_equal_a_loop():
    angles = jnp.linspace(0.0, 6.0, 12)
    the_model = model(four_effects())
    force_of = jax.jit(ForceModel.process_force)
    loop = jnp.stack([force_of(the_model, cut().replace(angle_rad=angle)) for angle in angles])
    mapped = jax.jit(jax.vmap(lambda angle: the_model.process_force(cut(angle_rad=angle))))(angles)
    broadcast = force_of(the_model, cut().replace(angle_rad=angles))
    np.testing.assert_allclose(mapped, loop, rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(broadcast, loop, rtol=1e-5, atol=1e-3)


def test_vmap_over_constants_and_effect_parameters():
    scale = jnp.array([0.5, 1.0, 2.0])
    offsets = jnp.array([0.0, 5e-6, 2e-5])

    @jax.jit
    def one(factor: Any, offset: Any) -> Any:
        changed = jax.tree.map(lambda constant: constant * factor, material())
        runout = effect_class("radial_runout")(offset, 0.2)
        return ForceModel(Tool("end_mill", 4, 0.02), changed, (runout,)).process_force(cut(angle_rad=0.9))

    loop = jnp.stack([one(factor, offset) for factor, offset in zip(scale, offsets, strict=True)])
    np.testing.assert_allclose(jax.vmap(one)(scale, offsets), loop, rtol=1e-5, atol=1e-3)
    batched = ForceModel(Tool("end_mill", 4, 0.02), jax.tree.map(lambda k: k * scale, material()))
    one_by_one = jnp.stack([one(factor, 0.0) for factor in scale])
    np.testing.assert_allclose(
        jax.jit(ForceModel.process_force)(batched, cut(angle_rad=0.9)), one_by_one, rtol=1e-4, atol=1e-2
    )


def test_step_is_compiled_once():
    traced = []

    @jax.jit
    def step(the_model: ForceModel, state: Any, here: Cut) -> Any:
        traced.append(None)
        return the_model.step(state, here, 0.002)

    the_model = model(four_effects())
    state = the_model.init()
    here = jax.tree.map(jnp.asarray, cut())
    for angle in (0.0, 0.5, 1.0):
        state, _, _ = step(the_model, state, here.replace(angle_rad=jnp.asarray(angle)))
    assert len(traced) == 1
