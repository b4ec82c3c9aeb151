"""Size effect: specific cutting force rises as the chip gets thinner (Kienzle 1952).

f = b [k_e + k_c h0 (h / h0)^(1 - m)], h0 a fixed reference thickness at which the law equals the base model.
In Kienzle's tables feed force and passive force have exponents of their own, mostly larger than that of the
cutting force: here multiples of it, radial and axial. Signature: no new lines; force concave in feed.
Confused with the edge constant k_e unless the feeds span about a decade.
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

REFERENCE_M = 5e-5
_THINNEST = 1e-6


@register
class SizeEffect(AbstractEffect):
    """Power law in chip thickness about h0 = 50 um.

    Fields: `exponent` [] Kienzle's m of the tangential force, 0 for the base model; `radial_ratio`,
    `axial_ratio` [] times it, they are those of the radial and of the axial force. A fit begins with all
    alike.
    """

    name = "size_effect"
    stage = "edge"
    strength = "exponent"
    alike = True
    parameters = {
        "exponent": Parameter("1", 0.0, 0.6, 0.0, 0.2, source="Kienzle: 0.1-0.4 for metals"),
        "radial_ratio": Parameter("1", 0.2, 5.0, 1.0, log=True, source="working knowledge: 1-3"),
        "axial_ratio": Parameter("1", 0.2, 5.0, 1.0, log=True, source="working knowledge: 1-3"),
    }
    signature = "no new lines; every line concave in feed"
    confused_with = {"edge constant": "a feed range of 10:1 separates them"}

    exponent: ArrayLike
    radial_ratio: ArrayLike = 1.0
    axial_ratio: ArrayLike = 1.0

    def edge(self, force: EdgeForce, chip: Chip, cut: Cut, model: ForceModel) -> EdgeForce:
        thin = jnp.maximum(chip.thickness_m / REFERENCE_M, _THINNEST)
        exponent = self.exponent * jnp.stack([1.0, self.radial_ratio, self.axial_ratio])
        return force._replace(chip=force.chip * thin[..., None] ** -exponent)

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 1

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> SizeEffect:
        """Coordinates: m in units of its usual value."""
        return cls(cls.parameters["exponent"].typical * coordinates[0])

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[0.3]])
