"""Lines of a tool that does not turn evenly: sums over angles that lie anywhere; some lines alone."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, effect_class, order_lines
from mjx_cutting.cutting.orders import _transformed

NODES, TEETH = 40, 24
RNG = np.random.default_rng(4)
ANGLE = RNG.uniform(-7.0, 7.0, (NODES, 1, TEETH))
VALUE = RNG.normal(size=(NODES, 1, TEETH, 3))


def summed(angle: jax.Array, value: jax.Array, orders: int) -> jax.Array:
    wave = jnp.exp(-1j * jnp.arange(orders + 1)[:, None] * angle.reshape(-1))
    return jnp.matmul(wave, value.reshape(-1, 3).astype(wave.dtype), precision="highest")


@pytest.mark.parametrize("orders", [0, 1, 7, 8, 130])
def test_lines_are_the_sums_over_all_angles(orders):
    with jax.enable_x64(True):
        found = _transformed(jnp.asarray(ANGLE), jnp.asarray(VALUE), orders)
        expected = summed(jnp.asarray(ANGLE), jnp.asarray(VALUE), orders)
    np.testing.assert_allclose(found, expected, atol=1e-10 * np.abs(expected).max())


def test_lines_change_with_the_angles_as_the_sums_do():
    with jax.enable_x64(True):
        angle, ahead, value = (jnp.asarray(each) for each in (ANGLE, RNG.normal(size=ANGLE.shape), VALUE))
        found, expected = (
            jax.jvp(lambda turned, lines=lines: lines(turned, value, 130), (angle,), (ahead,))[1]
            for lines in (_transformed, summed)
        )
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_lines_in_single_precision():
    angle, value = jnp.asarray(ANGLE, jnp.float32), jnp.asarray(VALUE, jnp.float32)
    found, expected = _transformed(angle, value, 130), summed(angle, value, 130)
    assert found.dtype == jnp.complex64
    np.testing.assert_allclose(found, expected, atol=3e-5 * np.abs(expected).max())


@pytest.mark.parametrize(
    "names",
    [
        (),
        ("radial_runout",),
        ("unequal_pitch", "unbalance"),
        ("sensor_resonance",),
        ("crosstalk",),
        ("torque_ripple",),
        ("static_compliance",),
        ("radial_runout", "joint_friction"),
    ],
)
def test_lines_wanted_alone_are_those_among_all(names):
    tool = Tool("slitting_saw", 12, 0.05, 0.0, slices=1)
    with jax.enable_x64(True):
        cut = Cut.milling(
            "conventional",
            0.05,
            angle_rad=0.3,
            spindle_speed_rev_s=10.0,
            feed_speed_m_s=0.02,
            radial_depth_m=0.004,
            axial_width_m=0.002,
        )
        effects = [effect_class(name) for name in names]
        parts = tuple(each.build(jnp.asarray(each.starts(tool))[-1], tool) for each in effects)
        model = ForceModel(tool, Material(9e8, 9e3, 3e8, 4e3, 5e7, 5e2), parts)
        every = np.asarray(order_lines(model, cut, 40, 960, 0.8))
        only = np.array([12, 1, 0, 37])
        some = np.asarray(order_lines(model, cut, 40, 960, 0.8, only=jnp.asarray(only)))
    np.testing.assert_allclose(some[only], every[only], rtol=0.0, atol=1e-9 * np.abs(every).max())
    assert not np.any(np.delete(some, only, axis=0))
