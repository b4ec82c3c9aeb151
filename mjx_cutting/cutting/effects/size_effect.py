"""Size effect: specific cutting force rises as the chip gets thinner (Kienzle 1952).

f = b [k_e + k_c h0 (h / h0)^(1 - m)], h0 a fixed reference thickness at which the law equals the base model.
Signature: no new lines; force concave in feed. Confused with the edge constant k_e unless the feeds span
about a decade.
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

REFERENCE_M = 5e-5
_THINNEST = 1e-6


@register
class SizeEffect(AbstractEffect):
    """Power law in chip thickness about h0 = 50 um.

    Fields: `exponent` [] Kienzle's m, 0 for the base model.
    """

    name = "size_effect"
    stage = "edge"
    strength = "exponent"
    alike = True
    parameters = {"exponent": Parameter("1", 0.0, 0.6, 0.0, 0.2, source="Kienzle: 0.1-0.4 for metals")}
    signature = "no new lines; every line concave in feed"
    confused_with = {"edge constant": "a feed range of 10:1 separates them"}

    exponent: ArrayLike

    def edge(self, force: EdgeForce, chip: Chip, cut: Cut, model: ForceModel) -> EdgeForce:
        thin = jnp.maximum(chip.thickness_m / REFERENCE_M, _THINNEST)
        return force._replace(chip=force.chip * (thin ** -jnp.asarray(self.exponent))[..., None])

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[0.3]])
