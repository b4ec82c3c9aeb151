"""Clogging: chips that do not fit the gullet are packed, and packing them takes force.

k_c (1 + eta max(0, fill - 1)), fill = A(th) / A_g, where A(th) = c R (cos th_in - cos th) is the area of chip
that the tooth has cut since it entered and A_g the area of solid chip that the gullet holds (its own area
over the chip's bulking, 3 to 10). It empties at exit. What is packed may rub too: an `edge_share` of the rise
falls to the edge constants, nil where packing only shears. Signature: one-sided, towards the end of the arc,
beyond a threshold in feed x arc. Confused with wear, which does not reset. Chips carried round for several
turns are not modelled.

How loosely chips lie depends on how thick they are, thin ones curl: of chips of another thickness than .1 mm
(c / .1 mm)^(q - 1) times as much fills the gullet, q the `thickness_power`, 1 where they lie alike. That is
told where drills are traced; of saws and mills it is 1.

A drill's flutes take all the chip of the hole: there fill = c s / A_g, c the feed per tooth and s the depth
of the hole, `Cut.position_m`; they are empty where it begins. Signature: force and torque rise from a depth
on that is the less the larger the feed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.chip import Chip
from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, EdgeForce, Parameter
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

REFERENCE_CHIP_M = 1e-4
"""Chips that fill as much as their area, whatever the power of their thickness, m."""


@register
class Clogging(AbstractEffect):
    """Force of packing chips into a full gullet.

    Fields: `gain` [] eta, rise of the chip force per overfill; `capacity_m2` [] area A_g of solid chip .1 mm
    thick that a gullet holds, m^2; `edge_share` [] eta of the edge force over that of the chip's;
    `thickness_power` [] power of the chip's thickness that the fill goes with.
    """

    name = "clogging"
    stage = "tool"
    strength = "gain"
    alike = True
    parameters = {
        "gain": Parameter("1", 0.0, 20.0, 0.0, 1.0, source="working knowledge"),
        "capacity_m2": Parameter("m^2", 1e-9, 1e-4, None, 1e-7, log=True, source="gullet area over bulking"),
        "edge_share": Parameter("1", 0.0, 1.0, None, 0.0),
        "thickness_power": Parameter("1", 0.1, 2.0, None, 1.0, source="working knowledge"),
    }
    signature = "one-sided rise late in the arc beyond a threshold in feed times arc; resets at exit"
    confused_with = {"flank_wear": "wear does not reset when the tool leaves the sheet"}

    gain: ArrayLike
    capacity_m2: ArrayLike
    edge_share: ArrayLike = 0.0
    thickness_power: ArrayLike = 1.0

    def edge(self, force: EdgeForce, chip: Chip, cut: Cut, model: ForceModel) -> EdgeForce:
        feed_m = jnp.asarray(cut.feed_per_revolution_m())[..., None, None] / model.tool.teeth
        if model.tool.kind == "drill":
            way_m = jnp.asarray(cut.position_m)[..., None, None]
        else:
            since = jnp.cos(jnp.asarray(cut.entry_rad))[..., None, None] - jnp.cos(chip.angle_rad)
            way_m = 0.5 * jnp.asarray(model.tool.diameter_m) * since
        looser = (feed_m / REFERENCE_CHIP_M) ** (jnp.asarray(self.thickness_power) - 1.0)
        area = looser * feed_m * jnp.maximum(way_m, 0.0)
        more = (self.gain * jnp.maximum(area / jnp.asarray(self.capacity_m2) - 1.0, 0.0))[..., None]
        return EdgeForce(force.chip * (1.0 + more), force.edge * (1.0 + self.edge_share * more))

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 3

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> Clogging:
        """Coordinates: gain, log(capacity / 1e-7 m^2), share of the edge."""
        gain, capacity, edge_share = coordinates
        return cls(gain, 1e-7 * jnp.exp(capacity), edge_share)

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[0.5, capacity, 0.5] for capacity in np.arange(-3.0, 5.5, 0.5)])
