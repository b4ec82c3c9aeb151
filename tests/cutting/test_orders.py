"""Lines of a tool that does not turn evenly: sums over angles that lie anywhere."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

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
