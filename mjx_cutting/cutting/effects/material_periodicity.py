"""Material periodicity: the sheet is harder and softer by turns along the path (corrugation, weave, cells).

k_c (1 + eps cos(2 pi s / Lam + phase)), s the position along the path; the edge constants vary by a share of
that: 0 where only the chip's resistance changes, 1 where the whole sheet is harder and softer. s is the place
of the tool's centre, or that of every tooth by itself, R sin th ahead of it, where the tooth meets the
pattern: over an arc longer than Lam that is all the difference. Signature:
lines at v / Lam (0.2 to 12 Hz) and beside tooth passing at f_t +- v / Lam, coherent in POSITION from trial to
trial. Confused with a mode of the robot, which keeps its frequency when the feed changes. Needs no column:
without a measured position the feed gives it, up to the phase.
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
from mjx_cutting.cutting.effects.coordinates import polar
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel


@register
class MaterialPeriodicity(AbstractEffect):
    """Constants that vary along the path.

    Fields: `amplitude` [] eps of the chip constants, relative; `wavelength_m` [] Lam, m; `phase_rad` [] at
    position 0, rad; `edge_share` [] eps of the edge constants over that of the chip's; `tooth_place` [] 0
    where s is the place of the tool's centre, 1 where it is that of the tooth.
    """

    name = "material_periodicity"
    stage = "edge"
    strength = "amplitude"
    parameters = {
        "amplitude": Parameter("1", 0.0, 1.15, 0.0, 0.3, source="0.1-1"),
        "wavelength_m": Parameter("m", 1e-3, 5e-2, None, 5e-3, log=True, source="2-10 mm"),
        "phase_rad": Parameter("rad", -np.pi, np.pi, None, 0.0),
        "edge_share": Parameter("1", 0.0, 1.0, None, 0.0),
        "tooth_place": Parameter("1", 0.0, 1.0, None, 0.0),
    }
    steady = False
    alike = True
    signature = "lines at v / wavelength and beside tooth passing, coherent in position"
    confused_with = {"robot_mode": "a mode keeps its frequency when the feed changes"}

    amplitude: ArrayLike
    wavelength_m: ArrayLike
    phase_rad: ArrayLike
    edge_share: ArrayLike = 0.0
    tooth_place: ArrayLike = 0.0

    def edge(self, force: EdgeForce, chip: Chip, cut: Cut, model: ForceModel) -> EdgeForce:
        place_m = jnp.asarray(cut.position_m)[..., None, None]
        if model.tool.kind not in ("drill", "turning"):
            place_m = place_m + self.tooth_place * 0.5 * model.tool.diameter_m * jnp.sin(chip.angle_rad)
        turn = 2.0 * jnp.pi * place_m / self.wavelength_m + self.phase_rad
        more = (self.amplitude * jnp.cos(turn))[..., None]
        return EdgeForce(force.chip * (1.0 + more), force.edge * (1.0 + self.edge_share * more))

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 3

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> MaterialPeriodicity:
        """Coordinates eps cos(phase), eps sin(phase) in units of 0.3, and log(Lam / 5 mm)."""
        amplitude, phase = polar(coordinates[0], coordinates[1])
        return cls(0.3 * amplitude, 5e-3 * jnp.exp(coordinates[2]), phase)

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[0.3, 0.0, shift] for shift in (-0.9, -0.3, 0.3, 0.9)])
