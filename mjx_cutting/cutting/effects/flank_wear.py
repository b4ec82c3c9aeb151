"""Flank wear: the worn land behind the edge rubs, so the edge constants grow with the length cut.

k_e(L) = k_e0 + kappa VB(L), one kappa a direction, and the land in its three stages

    VB(L) = VB_0 (1 - exp(-L / L_0)) + w L + w' max(0, L - L')

run-in, steady and late. Only kappa times the land is identifiable: the fit of the steady stage holds w at 1
um per metre, that of several stages the land at the longest length cut. Prior: the PHM 2010 tables (3
cutters, 315 cuts each) give VB 24-40 to 165-216 um with a slope of 0.21-0.33 N/um of axial force. Signature:
force monotone in CUT LENGTH, radial more than tangential, back to the start at a tool change; acts on thrust
and torque of a drill. Confused with drift of the sensor, which runs with the clock and shows in air. Breaks
at chipping, and where heat softens the sheet.
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

RATE = 1e-6
_TYPICAL_N_M2 = 1e9


@register
class FlankWear(AbstractEffect):
    """Edge constants that grow with wear.

    Fields: `kappa_n_m2` [3] tangential, radial and axial edge constant per metre of wear land, N/m^2; `rate`
    [] wear land per length cut in the steady stage, m/m; `initial_m`, `run_in_m` [] wear land of the run-in
    and the length it takes, m; `late_rate`, `late_start_m` [] added rate of the late stage and where it
    begins, m.
    """

    name = "flank_wear"
    stage = "edge"
    strength = "kappa_n_m2"
    alike = True
    parameters = {
        "kappa_n_m2": Parameter("N/m^2", 0.0, 1e13, 0.0, _TYPICAL_N_M2, length=3, source="PHM 2010: 1e9"),
        "rate": Parameter("m/m", 0.0, 1e-2, 0.0, RATE, source="VB 0-0.3 mm over a tool's life"),
        "initial_m": Parameter("m", 0.0, 1e-3, 0.0, 0.0, source="run-in, 0-50 um"),
        "run_in_m": Parameter("m", 1e-3, 1e3, None, 0.0, source="length of the run-in"),
        "late_rate": Parameter("m/m", 0.0, 1e-1, 0.0, 0.0),
        "late_start_m": Parameter("m", 0.0, 1e6, None, 0.0),
    }
    needs = ("cut length",)
    signature = "force monotone in cut length, radial more than tangential; resets at a tool change"
    confused_with = {
        "thermal_drift": "drift runs with the clock, not with the length cut, and shows in an air cut",
        "ploughing": "ploughing does not grow",
    }

    kappa_n_m2: ArrayLike
    rate: ArrayLike
    initial_m: ArrayLike = 0.0
    run_in_m: ArrayLike = 1.0
    late_rate: ArrayLike = 0.0
    late_start_m: ArrayLike = 0.0

    def land_m(self, cut_length_m: ArrayLike) -> Array:
        """[...] width VB of the wear land after a length cut, m."""
        length = jnp.asarray(cut_length_m)
        run_in = self.initial_m * -jnp.expm1(-length / jnp.asarray(self.run_in_m))
        late = self.late_rate * jnp.maximum(length - jnp.asarray(self.late_start_m), 0.0)
        return jnp.asarray(run_in + self.rate * length + late)

    def edge(self, force: EdgeForce, chip: Chip, cut: Cut, model: ForceModel) -> EdgeForce:
        land = self.land_m(cut.cut_length_m)[..., None, None, None]
        return force._replace(edge=force.edge + chip.width_m[..., None] * land * jnp.asarray(self.kappa_n_m2))

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 3

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> FlankWear:
        """Coordinates: kappa in units of 1e9 N/m^2 at a steady rate of 1 um of land per metre."""
        return cls(_TYPICAL_N_M2 * coordinates, jnp.asarray(RATE))

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[0.5, 1.0, 0.5]])

    @classmethod
    def identity(cls, tool: Tool) -> FlankWear:
        return cls(jnp.zeros(3), RATE)
