"""Broken tooth: one tooth cuts nothing, or less than its share, and the next one takes what it left.

h_j = (1 - s) c sin th, h_{j+1} = (1 + s) c sin th; s = 1 for a tooth that is gone. The broken tooth rubs less
in the same proportion. Signature: lines at all multiples of the spindle frequency that rise with feed from an
edge-force intercept, of sudden onset: there is nothing before the tool has cut a length `onset_m`. Confused
with runout, whose lines do not rise with feed. Breaks where more than one neighbour is gone. Altintas, Int.
J. Machine Tools and Manufacture 28 (1988) 157-172 (detection of tooth breakage from cutting forces).
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
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel


@register
class BrokenTooth(AbstractEffect):
    """One tooth that misses its chip.

    Fields: `share` [] part of its chip that the tooth misses, 0 whole to 1 gone; `tooth` [] its index, 0 to
    N - 1 (only known up to the phase of a trial, so the fit holds it at 0); `onset_m` [] length cut with the
    tool when it breaks, m, 0 for one broken from the start.
    """

    name = "broken_tooth"
    stage = "chip"
    strength = "share"
    parameters = {
        "share": Parameter("1", 0.5, 1.05, 0.0, 1.0, source="1 gone; less than half is a short tooth"),
        "tooth": Parameter("1", 0.0, 200.0, None, 0.0, source="index"),
        "onset_m": Parameter("m", 0.0, 1e5, None, 0.0, source="read from the trials that show it first"),
    }
    idle_teeth = True
    signature = "comb at the spindle frequency that rises with feed from an intercept, of sudden onset"
    confused_with = {
        "radial_runout": "the line of runout is flat in feed and bounded by 100 um",
        "unequal_pitch": "a broken tooth loads one successor only, and sets in suddenly",
    }

    share: ArrayLike
    tooth: ArrayLike
    onset_m: ArrayLike = 0.0

    def chip(self, chip: Chip, cut: Cut, model: ForceModel) -> Chip:
        teeth = model.tool.teeth
        index = jnp.arange(teeth)
        onset_m = jnp.asarray(self.onset_m)
        off = (jnp.asarray(cut.cut_length_m)[..., None, None] >= onset_m) | (onset_m <= 0.0)
        broken = self.share * off * (index == jnp.round(jnp.asarray(self.tooth)))
        left_over = jnp.roll(broken, 1, axis=-1)
        feed_m = jnp.asarray(cut.feed_per_revolution_m())[..., None, None] / teeth
        more = feed_m * jnp.maximum(jnp.sin(chip.angle_rad), 0.0) * left_over
        return chip._replace(thickness_m=chip.thickness_m + more, contact=chip.contact * (1.0 - broken))

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 0 if tool.teeth == 1 else 1

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> BrokenTooth:
        return cls(jnp.sum(coordinates), jnp.zeros(()))

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[0.6], [0.95]])[:, : cls.size(tool)]
