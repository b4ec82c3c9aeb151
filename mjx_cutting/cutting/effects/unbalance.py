"""Unbalance: the tool's centre of mass is off its axis, and a force turns with the teeth.

F = m e Omega^2 (sin, cos)(th + phase), Omega in RADIANS per second. Signature: one line at the spindle
frequency that goes with the square of the speed, whatever the feed, in air too. Confused with runout, which
an air cut does not show.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.coordinates import polar
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

_TYPICAL_KG_M = 1e-5


@register
class Unbalance(AbstractEffect):
    """A mass off the axis.

    Fields: `moment_kg_m` [] m e, kg m (10 g mm is 1e-5); `phase_rad` [] ahead of tooth 0, rad.
    """

    name = "unbalance"
    stage = "tool"
    strength = "moment_kg_m"
    parameters = {
        "moment_kg_m": Parameter("kg m", 0.0, 1.25e-4, 0.0, _TYPICAL_KG_M, source="1-100 g mm"),
        "phase_rad": Parameter("rad", -np.pi, np.pi, None, 0.0),
    }
    signature = "one line at the spindle frequency, with the square of the speed, in air too"
    confused_with = {"radial_runout": "an air cut shows unbalance and not runout"}

    moment_kg_m: ArrayLike
    phase_rad: ArrayLike

    def body(self, force: Array, cut: Cut, model: ForceModel) -> Array:
        rate = 2.0 * jnp.pi * jnp.asarray(cut.spindle_speed_rev_s)
        angle = jnp.asarray(cut.angle_rad) + self.phase_rad
        size = self.moment_kg_m * rate**2
        turning = jnp.stack([jnp.sin(angle), jnp.cos(angle), jnp.zeros_like(angle)], axis=-1)
        return force + jnp.asarray(size)[..., None] * turning

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> Unbalance:
        """Cartesian coordinates in units of 10 g mm."""
        moment, phase = polar(coordinates[0], coordinates[1])
        return cls(_TYPICAL_KG_M * moment, phase)

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[0.5, 0.0], [0.0, 5.0]])
