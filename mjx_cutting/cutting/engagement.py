"""Where a tooth is in the sheet: the engagement arc, and how much of a small angle lies inside it.

Angles run clockwise from +y, so a tooth meets the sheet at 0 when cutting conventionally and leaves it at
acos(1 - a/R). A tooth that enters or leaves between two samples must not be counted wholly in or out: a hard
on/off test on a time grid leaves lines at the spindle frequency that look like runout. `inside` therefore
gives the SHARE of the angle step `width_rad` that lies inside the arc, which is also differentiable in the
phase.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

MILLING = ("slot", "conventional", "climb")
_SHARP_RAD = 1e-6


def arc(milling: str, radial_depth_m: ArrayLike, diameter_m: ArrayLike) -> tuple[Array, Array]:
    """Entry and exit angle of a tooth, rad.

    Arguments:
        milling: "slot" (0 to pi), "conventional" (0 to acos(1 - a/R)) or "climb" (pi - acos(1 - a/R) to pi).
        radial_depth_m: [...] depth of cut a, m; not read for a slot; at or below zero the arc is empty.
        diameter_m: [...] tool diameter 2 R, m. A depth beyond D counts as D.

    Raises:
        ValueError: unknown kind of milling.
    """
    if milling not in MILLING:
        raise ValueError(f"milling is {milling!r}; expected one of {', '.join(MILLING)}")
    ratio = jnp.asarray(radial_depth_m) / (0.5 * jnp.asarray(diameter_m))
    if milling == "slot":
        zero = jnp.zeros_like(ratio)
        return zero, zero + jnp.pi
    swept = _arccos_one_minus(ratio)
    if milling == "conventional":
        return jnp.zeros_like(swept), swept
    return jnp.pi - swept, jnp.full_like(swept, jnp.pi)


def inside(angle_rad: ArrayLike, entry_rad: ArrayLike, exit_rad: ArrayLike, width_rad: ArrayLike) -> Array:
    """[...] share, 0 to 1, of the angle step of `width_rad` centred on `angle_rad` that lies in the arc.

    `angle_rad` may lie outside one turn. An arc of zero length gives zero.
    """
    middle = 0.5 * (jnp.asarray(entry_rad) + exit_rad)
    half = 0.5 * (jnp.asarray(exit_rad) - entry_rad)
    offset = jnp.abs(wrap(angle_rad - middle))
    width = jnp.maximum(width_rad, _SHARP_RAD)
    # from the distance to the nearer end, so that a narrow step keeps its digits in float32
    return jnp.clip(jnp.minimum((half - offset) / width + 0.5, 2.0 * half / width), 0.0, 1.0)


def wrap(angle_rad: ArrayLike) -> Array:
    """[...] the same angle in [-pi, pi), rad."""
    angle = jnp.asarray(angle_rad)
    return angle - 2.0 * jnp.pi * jnp.floor(angle / (2.0 * jnp.pi) + 0.5)


def _arccos_one_minus(ratio: Array) -> Array:
    """acos(1 - ratio) with a finite slope at both ends, zero below and pi above the range [0, 2]."""
    inner = jnp.clip(ratio, 1e-12, 2.0 - 1e-6)
    angle = 2.0 * jnp.arcsin(jnp.sqrt(0.5 * inner))
    return jnp.where(ratio <= 0.0, 0.0, jnp.where(ratio >= 2.0, jnp.pi, angle))
