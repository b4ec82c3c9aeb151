"""Clogging: chips that do not fit the gullet are packed, and packing them takes force.

k_c (1 + eta max(0, fill - 1)), fill = A(th) / A_g, where A(th) = c R (cos th_in - cos th) is the area of chip
that the tooth has cut since it entered and A_g the area of solid chip that the gullet holds (its own area
over the chip's bulking, 3 to 10). It empties at exit. Signature: one-sided, towards the end of the arc,
beyond a threshold in feed x arc. Confused with wear, which does not reset. Chips carried round for several
turns are not modelled.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from mjx_cutting.cutting.chip import Chip
from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, EdgeForce, Parameter
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel


@register
class Clogging(AbstractEffect):
    """Force of packing chips into a full gullet.

    Fields: `gain` [] eta, rise of the chip force per overfill; `capacity_m2` [] area A_g of solid chip a
    gullet holds, m^2.
    """

    name = "clogging"
    stage = "tool"
    strength = "gain"
    alike = True
    parameters = {
        "gain": Parameter("1", 0.0, 20.0, 0.0, 1.0, source="working knowledge"),
        "capacity_m2": Parameter("m^2", 1e-9, 1e-4, None, 1e-7, log=True, source="gullet area over bulking"),
    }
    signature = "one-sided rise late in the arc beyond a threshold in feed times arc; resets at exit"
    confused_with = {"flank_wear": "wear does not reset when the tool leaves the sheet"}

    gain: ArrayLike
    capacity_m2: ArrayLike

    def edge(self, force: EdgeForce, chip: Chip, cut: Cut, model: ForceModel) -> EdgeForce:
        feed_m = jnp.asarray(cut.feed_per_revolution_m())[..., None, None] / model.tool.teeth
        since = jnp.cos(jnp.asarray(cut.entry_rad))[..., None, None] - jnp.cos(chip.angle_rad)
        area = feed_m * 0.5 * jnp.asarray(model.tool.diameter_m) * jnp.maximum(since, 0.0)
        packed = 1.0 + self.gain * jnp.maximum(area / jnp.asarray(self.capacity_m2) - 1.0, 0.0)
        return force._replace(chip=force.chip * packed[..., None])

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[0.5, float(capacity)] for capacity in range(-3, 6)])
