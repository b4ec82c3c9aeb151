"""Layered material: the force steps where the path crosses into another layer, an inclusion or a void.

k -> k (1 + change) for positions between start and start + length, with borders that ramp over some way: 20
um where nothing else is said, what blends two layers, or the height of a drill's point, whose lips meet a
border one place after another from the centre outwards, so that the torque comes later than the thrust; where
it comes with it (`torque_power` 1), the layers themselves blend. Where layers are of different materials, as
in a laminate, the tangential, radial and axial constants take a share of the change each. For several layers
give the model several of these. Signature: one-sided steps at fixed positions, heavy tails. Confused with the
entry into the sheet, which is elsewhere.
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

BORDER_M = 2e-5
TORQUE_POWER = 2.0
"""What power of the way across a border the torque of a drill's lips follows: an element of length dr at the
radius r has dr of the thrust, and r dr of the torque."""


@register
class LayeredMaterial(AbstractEffect):
    """One layer across the path.

    Fields: `change` [] relative change of the constants inside, -1 for a void; `start_m`, `length_m` [] where
    it begins along the path and how long it is, between the middles of its borders, m; `border_m` [] way over
    which each of them ramps, m; `edge_share` [] change of the edge constants over that of the chip's, 1 where
    all change alike, 0 where the layer only shears harder or softer; `direction_share` [3] [] change of the
    tangential, radial and axial constants over `change`, which is that of those that change most;
    `torque_power` [] power of the way across a border that a drill's torque follows.
    """

    name = "layered_material"
    stage = "edge"
    strength = "change"
    parameters = {
        "change": Parameter("1", -1.15, 5.0, 0.0, 0.5, source="-1 is a void"),
        "start_m": Parameter("m", -1.0, 10.0, None, 0.0),
        "length_m": Parameter("m", 1e-4, 10.0, None, 0.02, log=True),
        "border_m": Parameter("m", 1e-6, 2e-2, None, BORDER_M, log=True),
        "edge_share": Parameter("1", 0.0, 1.0, None, 0.0, source="0 or 1", whole=True),
        "direction_share": Parameter("1", -1.15, 1.15, None, 1.0, length=3),
        "torque_power": Parameter("1", 0.5, 3.0, None, TORQUE_POWER, source="of drills; 1 or 2", whole=True),
    }
    steady = False
    alike = True
    signature = "one-sided steps at fixed positions"
    confused_with = {"entry_exit": "entry is at the end of the sheet"}

    change: ArrayLike
    start_m: ArrayLike
    length_m: ArrayLike
    border_m: ArrayLike = BORDER_M
    edge_share: ArrayLike = 1.0
    direction_share: ArrayLike = 1.0
    torque_power: ArrayLike = TORQUE_POWER

    def edge(self, force: EdgeForce, chip: Chip, cut: Cut, model: ForceModel) -> EdgeForce:
        since = jnp.asarray(cut.position_m) - self.start_m
        entered, left = (
            jnp.clip(0.5 + past / jnp.asarray(self.border_m), 0.0, 1.0)[..., None]
            for past in (since, since - self.length_m)
        )
        torque = jnp.asarray(self.torque_power if model.tool.kind == "drill" else 1.0)
        power = jnp.stack([torque, jnp.ones_like(torque), jnp.ones_like(torque)], axis=-1)
        change = jnp.asarray(self.change)[..., None] * (entered**power - left**power) * self.direction_share
        change = change[..., None, None, :]
        return EdgeForce(force.chip * (1.0 + change), force.edge * (1.0 + self.edge_share * change))

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 4

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> LayeredMaterial:
        """Coordinates: change in units of .5, start in 10 mm, logs of length in 20 mm, border in 20 um."""
        change, start, length, border = coordinates
        return cls(
            0.5 * change, 1e-2 * start, 2e-2 * jnp.exp(length), BORDER_M * jnp.exp(border), 1.0, jnp.ones(3)
        )

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[0.3, float(start), 0.0, 0.0] for start in (0, 2, 5, 10)])
