"""Coordinates that the fit can work in where physical parameters are polar."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array


def polar(x: Array, y: Array) -> tuple[Array, Array]:
    """Length and direction, rad, of (x, y), with finite slopes at the origin (where the direction is 0)."""
    still = (x == 0.0) & (y == 0.0)
    length = jnp.where(still, 0.0, jnp.sqrt(jnp.where(still, 1.0, x * x + y * y)))
    return length, jnp.where(still, 0.0, jnp.arctan2(y, jnp.where(still, 1.0, x)))
