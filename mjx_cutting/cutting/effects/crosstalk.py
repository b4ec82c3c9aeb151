"""Crosstalk: each axis of the sensor also shows a little of the others.

F_m = (I + eps) F. The diagonal is left out: a gain cannot be told from the constants. Signature: a scaled
copy of another axis, the mean included. Confused with oblique cutting; hang a known load.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.registry import register

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel


@register
class Crosstalk(AbstractEffect):
    """Off-diagonal sensitivities.

    Fields: `coupling` [6] share of y in x, z in x, x in y, z in y, x in z, y in z.
    """

    name = "crosstalk"
    stage = "sensor"
    strength = "coupling"
    parameters = {
        "coupling": Parameter("1", -0.2, 0.2, 0.0, 0.02, length=6, source="0.5-3 %"),
    }
    signature = "scaled copy of another axis, mean included"
    confused_with = {"oblique cutting": "hang a known load on the sensor"}

    coupling: ArrayLike

    def sense(self, force: Array, cut: Cut, model: ForceModel) -> Array:
        xy, xz, yx, yz, zx, zy = jnp.asarray(self.coupling)
        x, y, z = force[..., 0], force[..., 1], force[..., 2]
        return force + jnp.stack([xy * y + xz * z, yx * x + yz * z, zx * x + zy * y], axis=-1)
