"""Tooth path: the teeth move on trochoids, not on circles one beside the other.

The surface that the tooth before left is curved, and was left a little earlier or later than an even turn
would have it (`chip.fed`): h = d sin th + (d cos th)^2 / 2 R, d = c / (1 + N c cos th / (2 pi R)). On the
side of the cut they leave cusps between them, which the next tooth meets up to c / 2 R before or after the
arc (`chip.swept`): its edge force lasts that much longer. This is geometry, with nothing to be found: where
the feed per tooth c is not small against the radius R, tracing asks which of the paths the trials have, and
never calls it a cause. Signature: chips thicker at the ends of the arc, thinner where the tooth goes against
the feed, as c / R. Confused with whatever makes the chip depend on the angle: runout does so once a turn,
static compliance with the force.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.chip import Cutter
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel


@register
class ToothPath(AbstractEffect):
    """The true path of the teeth of a mill or saw.

    Fields: `share` [] of the curvature 1 / R: 0 circles, 1 the true path; `cusps` [] 1 where the edges meet
    the cusps too, 0 where they act in the nominal arc alone.
    """

    name = "tooth_path"
    stage = "chip"
    physical = False
    strength = "share"
    parameters = {
        "share": Parameter("1", 0.0, 2.0, 0.0, 1.0, source="geometry: 0 or 1"),
        "cusps": Parameter("1", 0.0, 1.0, None, 0.0, source="geometry: 1"),
    }
    signature = "chips thicker at the ends of the arc, thinner against the feed, as feed per tooth to radius"
    confused_with = {"static_compliance": "a structure gives way with the force, the path goes with the feed"}

    share: ArrayLike
    cusps: ArrayLike = 1.0

    def cutter(self, cutter: Cutter, model: ForceModel) -> Cutter:
        curvature = 2.0 * jnp.asarray(self.share) / model.tool.diameter_m
        return cutter._replace(curvature_1_m=curvature, cusps=jnp.asarray(self.cusps))

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 0 if tool.kind in ("drill", "turning") else 1

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> ToothPath:
        return cls(jnp.sum(coordinates))

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[0.5]])[:, : cls.size(tool)]
