"""Unequal pitch: the teeth are not evenly spaced, so each takes a chip in proportion to the gap before it.

h_j = (N delta_j / 2 pi) c sin th_j, delta_j the angle from the tooth before; teeth also arrive early or late.
Altintas, Manufacturing Automation, 2nd ed. (2012), section 4.7 (variable pitch cutters). Signature: lines at
the spindle frequency that RISE with feed from an intercept due to the edge force.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.chip import Cutter
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.coordinates import with_no_sum
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

TYPICAL_RAD = 0.02


@register
class UnequalPitch(AbstractEffect):
    """Errors of tooth spacing.

    Fields: `pitch_error_rad` [N] error of the gap before each tooth, delta_j - 2 pi / N, rad; the mean is
    removed, so the gaps always add up to one turn.
    """

    name = "unequal_pitch"
    stage = "chip"
    strength = "pitch_error_rad"
    parameters = {
        "pitch_error_rad": Parameter(
            "rad", -0.35, 0.35, 0.0, TYPICAL_RAD, per_tooth=True, source="0.1-5 deg, 20 by design"
        )
    }
    signature = "once-per-revolution line that rises with feed from an edge-force intercept"
    confused_with = {"radial_runout": "the line of runout is flat in feed"}

    pitch_error_rad: ArrayLike

    def cutter(self, cutter: Cutter, model: ForceModel) -> Cutter:
        error = jnp.asarray(self.pitch_error_rad)
        late = jnp.cumsum(error - error.mean())
        return cutter._replace(lag_rad=cutter.lag_rad + late - late[0], even=False)

    @classmethod
    def size(cls, tool: Tool) -> int:
        return tool.teeth - 1

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> UnequalPitch:
        """Coordinates: errors of all gaps but the last, in units of 0.02 rad; the last closes the turn."""
        return cls(with_no_sum(TYPICAL_RAD * coordinates))

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        alternate = np.where(np.arange(cls.size(tool)) % 2 == 0, 1.0, -1.0)
        return np.asarray([0.5 * alternate, -0.5 * alternate])
