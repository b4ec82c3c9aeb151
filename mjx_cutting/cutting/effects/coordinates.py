"""Coordinates that the fit can work in where physical parameters are polar, or a frequency is to be found
among lines that stand far apart."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import Array

_TUNED = np.log(np.geomspace(0.6, 1.6, 16))


def polar(x: Array, y: Array) -> tuple[Array, Array]:
    """Length and direction, rad, of (x, y), with finite slopes at the origin (where the direction is 0)."""
    still = (x == 0.0) & (y == 0.0)
    length = jnp.where(still, 0.0, jnp.sqrt(jnp.where(still, 1.0, x * x + y * y)))
    return length, jnp.where(still, 0.0, jnp.arctan2(y, jnp.where(still, 1.0, x)))


def with_no_sum(free: Array) -> Array:
    """[N] values of all teeth, of which those of all but the last are `free` [N - 1]: their sum is nil."""
    return jnp.concatenate([free, -jnp.sum(free, keepdims=True)])


def retuned(coordinates: np.ndarray, index: int) -> np.ndarray:
    """[16, size] the coordinates with the one at `index`, the logarithm of a frequency, moved to either side:
    few lines beside a resonance are met nearly as well from the wrong side of one of them."""
    starts = np.tile(coordinates, (len(_TUNED), 1))
    starts[:, index] += _TUNED
    return starts
