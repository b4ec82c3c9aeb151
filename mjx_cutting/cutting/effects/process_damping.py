"""Process damping: the flank rubs on the wave it has just cut, which damps vibration at low cutting speed.

F_r = C b v_n / v_c on every tooth in the cut, v_n the speed at which its edge moves into the sheet, v_c the
cutting speed (Altintas, Eynian and Onozuka, CIRP Annals 57 (2008) 371-374); or F_y = -C b y' / v_c on the
tool as one, as long as it is in the sheet, which is the same where the teeth in the cut share all directions
evenly (four in a slot). It needs the tool's vibration: from regenerative_chatter in the same model, or given
in `Cut.vibration_x_m_s` and `vibration_y_m_s` (the simulation knows it).
Signature: less vibration at low cutting speed. Confused with structural damping, which does not change with
the speed. Breaks for vibration larger than the wear land.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.chip import Chip
from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, EdgeForce, Parameter
from mjx_cutting.cutting.effects.registry import register

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

_SLOWEST_M_S = 1e-3


@register
class ProcessDamping(AbstractEffect):
    """Radial damping of the tool's vibration at the edge.

    Fields: `damping_n_m` [] C, N/m; `of_tool` [] 0 where each tooth in the cut is damped, 1 the tool as one.
    """

    name = "process_damping"
    stage = "edge"
    strength = "damping_n_m"
    parameters = {
        "damping_n_m": Parameter("N/m", 0.0, 5e6, 0.0, 1e5, source="1e5-1e6 N/m"),
        "of_tool": Parameter("1", 0.0, 1.0, None, 0.0, source="0 or 1", whole=True),
    }
    needs = ("tool velocity",)
    steady = False
    alike = True
    signature = "less vibration at low cutting speed"
    confused_with = {"regenerative_chatter": "structural damping does not vary with the cutting speed"}

    damping_n_m: ArrayLike
    of_tool: ArrayLike = 0.0

    def edge(self, force: EdgeForce, chip: Chip, cut: Cut, model: ForceModel) -> EdgeForce:
        along = jnp.asarray(cut.vibration_x_m_s)[..., None, None]
        into = jnp.asarray(cut.vibration_y_m_s)[..., None, None]
        plunge = along * jnp.sin(chip.angle_rad) + into * jnp.cos(chip.angle_rad)
        share = self._share(cut, model)[..., None, None] * (1.0 - jnp.asarray(self.of_tool))
        return force._replace(edge=force.edge.at[..., 1].add(share * chip.width_m * plunge))

    def body(self, force: Array, cut: Cut, model: ForceModel) -> Array:
        inside = jnp.asarray(cut.exit_rad) > jnp.asarray(cut.entry_rad)
        width_m = jnp.where(inside, jnp.asarray(cut.axial_width_m), 0.0)
        pressed = self._share(cut, model) * width_m * jnp.asarray(cut.vibration_y_m_s)
        return force.at[..., 1].add(-pressed * jnp.asarray(self.of_tool))

    def _share(self, cut: Cut, model: ForceModel) -> Array:
        """[...] C / v_c, N s/m^2."""
        cutting = jnp.pi * jnp.asarray(model.tool.diameter_m) * jnp.asarray(cut.spindle_speed_rev_s)
        return jnp.asarray(self.damping_n_m) / jnp.maximum(cutting, _SLOWEST_M_S)
