"""Torque ripple: the motor turns faster and slower p times a revolution, so chips differ with the angle.

f = f_0 (1 + eps cos(p th + phase)); the chip follows from the time since the tooth before passed, and the
angle runs ahead of its mean by (eps / p) sin(p th + phase), to first order in eps. Signature: small lines at
p f_s while cutting. Confused with runout, which is of order 1. A measured angle may hold the ripple already
(`Cut.angle_holds_ripple`): then only the chips show it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.chip import Chip
from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.coordinates import polar
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.swing import chip_by_time
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

_TYPICAL = 0.005
_ORDERS = range(2, 15)


@register
class TorqueRipple(AbstractEffect):
    """Speed that ripples with the angle.

    Fields: `amplitude` [] eps, relative; `order` [] p, times a revolution; `phase_rad` [] rad.
    """

    name = "torque_ripple"
    stage = "spindle"
    strength = "amplitude"
    parameters = {
        "amplitude": Parameter("1", 0.0, 0.1, 0.0, _TYPICAL, source="0.1-2 %"),
        "order": Parameter("1", 0.0, 50.0, None, 0.0, source="poles and slots: 2-14", whole=True),
        "phase_rad": Parameter("rad", -np.pi, np.pi, None, 0.0),
    }
    per_turn = True
    signature = "small lines at p times the spindle frequency while cutting"
    confused_with = {"radial_runout": "runout is of order 1 and does not move with the motor"}

    amplitude: ArrayLike
    order: ArrayLike
    phase_rad: ArrayLike

    def spindle(self, cut: Cut, model: ForceModel) -> Cut:
        ahead = self.ahead(cut.angle_rad) * (1.0 - jnp.asarray(cut.angle_holds_ripple))
        return cut.replace(angle_rad=cut.angle_rad + ahead)

    def ahead(self, angle_rad: ArrayLike) -> Array:
        order = jnp.asarray(self.order)
        turned = jnp.sin(order * jnp.asarray(angle_rad) + self.phase_rad)
        return turned * jnp.asarray(self.amplitude) / order

    def chip(self, chip: Chip, cut: Cut, model: ForceModel) -> Chip:
        return chip_by_time(chip, cut, model, self.ahead)

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> TorqueRipple:
        """Coordinates eps cos(phase), eps sin(phase) in units of 0.5 %, and a quarter of the order."""
        amplitude, phase = polar(coordinates[0], coordinates[1])
        order = jnp.maximum(jnp.round(4.0 * coordinates[2]), 1.0)
        return cls(_TYPICAL * amplitude, order, phase)

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        # the order is whole, so no fit moves it: each is a start of its own
        return np.asarray([[0.5, 0.0, 0.25 * order] for order in _ORDERS])

    @classmethod
    def identity(cls, tool: Tool) -> TorqueRipple:
        return cls(0.0, 4.0, 0.0)
