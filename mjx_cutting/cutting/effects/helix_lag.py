"""Helix lag: the edge at height z arrives later, by 2 z tan(beta) / D.

A correction to the tool's own helix angle. Altintas, Manufacturing Automation, 2nd ed. (2012), section 2.8.
The edges stay cylindrical and no axial force comes from the lag by itself. Signature: a loss of amplitude
like a sinc in ORDER, the same at every speed; the mean of a full slot unchanged. Confused with a low-pass
filter, whose loss is at a fixed frequency: change the speed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jax.typing import ArrayLike

from mjx_cutting.cutting.chip import Cutter
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

_SLICES = 8


@register
class HelixLag(AbstractEffect):
    """Error of the helix angle.

    Fields: `helix_rad` [] correction added to `Tool.helix_rad`, rad; left-hand is negative.
    """

    name = "helix_lag"
    stage = "chip"
    strength = "helix_rad"
    damps = True
    parameters = {"helix_rad": Parameter("rad", -1.3, 1.3, 0.0, 0.3, source="helix 0-45 deg")}
    signature = "amplitude lost like a sinc in order, at any speed; full-slot mean unchanged"
    confused_with = {"sensor_lowpass": "a filter loses at a fixed frequency; change the spindle speed"}

    helix_rad: ArrayLike

    def cutter(self, cutter: Cutter, model: ForceModel) -> Cutter:
        return cutter._replace(
            helix_rad=cutter.helix_rad + self.helix_rad, slices=max(cutter.slices, _SLICES)
        )

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        # lines of unknown phase do not tell the hand of a helix: of teeth said to be straight, the right
        return np.asarray([[0.5], [-0.5]] if float(np.asarray(tool.helix_rad)) else [[0.5]])
