"""Radial runout: the axis of the teeth is not the axis of rotation, so teeth cut on different radii.

r_j = rho cos(lam - 2 pi j / N), with carry-over of the surface left by shorter teeth (see `cutting.chip`).
Kline and DeVor, Int. J. Machine Tool Design and Research 23 (1983) 123-140. Signature: lines at the spindle
frequency and its multiples beside tooth passing whose amplitude, about k_c b rho, is FLAT in feed until teeth
drop out. lam is known only modulo 2 pi / N while the phase of a trial is free; with two teeth only rho
cos(lam) acts, and lam is held at zero.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.chip import Cutter
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.coordinates import polar
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

TYPICAL_M = 1e-5


@register
class RadialRunout(AbstractEffect):
    """Offset of the cutter's axis.

    Fields: `offset_m` [] offset rho, m; `angle_rad` [] direction lam of the offset from tooth 0, rad.
    """

    name = "radial_runout"
    stage = "chip"
    strength = "offset_m"
    parameters = {
        "offset_m": Parameter("m", 0.0, 1e-4, 0.0, TYPICAL_M, source="2-50 um usual, 100 um the bound"),
        "angle_rad": Parameter("rad", -np.pi, np.pi, None, 0.0),
    }
    signature = "once-per-revolution line flat in feed, on both radial axes"
    confused_with = {
        "unbalance": "an air cut shows unbalance and not runout",
        "unequal_pitch": "the line of unequal pitch rises with feed",
        "broken_tooth": "the line of a broken tooth rises with feed",
    }

    offset_m: ArrayLike
    angle_rad: ArrayLike

    def cutter(self, cutter: Cutter, model: ForceModel) -> Cutter:
        shift = self.offset_m * jnp.cos(self.angle_rad - model.tool.pitch_rad)
        return cutter._replace(radius_m=cutter.radius_m + shift, even=False)

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 0 if tool.teeth == 1 else 1 if tool.teeth == 2 else 2

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> RadialRunout:
        """Cartesian coordinates rho cos(lam), rho sin(lam) in units of 10 um."""
        if tool.teeth <= 2:
            return cls(TYPICAL_M * jnp.sum(coordinates), jnp.zeros(()))
        offset, angle = polar(coordinates[0], coordinates[1])
        return cls(TYPICAL_M * offset, angle)

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        if tool.teeth <= 2:
            return np.asarray([[0.2], [1.0]])[:, : cls.size(tool)]
        return np.asarray([[0.3, 0.0], [1.0, 0.0]])
