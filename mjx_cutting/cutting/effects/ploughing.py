"""Ploughing: below a minimum chip thickness the edge pushes material aside instead of shearing it.

f = b [k_p min(h, h_min) + k_c max(h - h_min, 0)], k_p = q k_c, one q a direction: an edge that ploughs
pushes away more than it drags along. Waldorf, DeVor and Kapoor, J. Manufacturing Science and Engineering 120
(1998) 693-699; h_min is 0.2 to 0.4 of the edge radius. Where the borderline is gradual, h_min (1 - exp(-h /
h_min)) is ploughed instead of min(h, h_min): as stiff at first, and as large an edge force at high feed.
Signature: extra force at entry and exit and at low feed; at high feed it is an edge constant. Confused with
wear, which a sharp edge does not show, and with the size effect, which never levels off.
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

_THINNEST_M = 1e-10
_UNIT_M = 8e-6  # so that a sharp edge and a honed one are within a decade of 1


@register
class Ploughing(AbstractEffect):
    """A stiffer force law below the minimum chip thickness.

    Fields: `minimum_chip_m` [] h_min, m; `ratio` [3] q, stiffness below h_min over that above it, tangential,
    radial and axial (one number for all three will do); `gradual` [] 1 where the borderline is, 0 where it is
    sharp.
    """

    name = "ploughing"
    stage = "edge"
    strength = "minimum_chip_m"
    alike = True
    parameters = {
        "minimum_chip_m": Parameter(
            "m", 0.0, 1e-4, 0.0, 2e-6, source="0.2-0.4 of an edge radius of 2-250 um, a honed insert's"
        ),
        "ratio": Parameter("1", 0.5, 30.0, None, 3.0, log=True, length=3, source="working knowledge"),
        "gradual": Parameter("1", 0.0, 1.0, None, 0.0, source="0 or 1", whole=True),
    }
    signature = "extra force at entry, exit and low feed that levels off with feed"
    confused_with = {
        "flank_wear": "ploughing is there while the tool is sharp",
        "size_effect": "the size effect goes on bending at high feed; five feeds over 10:1 separate them",
    }

    minimum_chip_m: ArrayLike
    ratio: ArrayLike
    gradual: ArrayLike = 0.0

    def edge(self, force: EdgeForce, chip: Chip, cut: Cut, model: ForceModel) -> EdgeForce:
        within = self.minimum_chip_m / jnp.maximum(chip.thickness_m, _THINNEST_M)
        # the quotient has no derivative where nothing is ploughed
        thick = jnp.where(within > 0.0, within, 1.0)
        gradual = jnp.where(within > 0.0, -within * jnp.expm1(-1.0 / thick), 0.0)
        ploughed = jnp.where(jnp.asarray(self.gradual) > 0.5, gradual, jnp.minimum(1.0, within))
        return force._replace(chip=force.chip * (1.0 + (jnp.asarray(self.ratio) - 1.0) * ploughed[..., None]))

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 4

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> Ploughing:
        """Coordinates: h_min in units of 8 um, the logarithms of the ratios over their usual values."""
        ratio = cls.parameters["ratio"]
        return cls(_UNIT_M * coordinates[0], ratio.typical * jnp.exp(coordinates[1:4]))

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[times, 0.0, 0.0, 0.0] for times in (0.125, 0.75, 3.0, 9.0)])
