"""Process damping: the flank rubs on the wave it has just cut, which damps vibration at low cutting speed.

F_r = C b v_n / v_c, v_n the speed at which the edge moves into the sheet, v_c the cutting speed. Altintas,
Eynian and Onozuka, CIRP Annals 57 (2008) 371-374. It needs the tool's vibration: from regenerative_chatter
in the same model, or given in `Cut.vibration_x_m_s` and `vibration_y_m_s` (the simulation knows it).
Signature: less vibration at low cutting speed. Confused with structural damping, which does not change with
the speed. Breaks for vibration larger than the wear land.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
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

    Fields: `damping_n_m` [] C, N/m.
    """

    name = "process_damping"
    stage = "edge"
    strength = "damping_n_m"
    parameters = {"damping_n_m": Parameter("N/m", 0.0, 5e6, 0.0, 1e5, source="1e5-1e6 N/m")}
    needs = ("tool velocity",)
    steady = False
    alike = True
    signature = "less vibration at low cutting speed"
    confused_with = {"regenerative_chatter": "structural damping does not vary with the cutting speed"}

    damping_n_m: ArrayLike

    def edge(self, force: EdgeForce, chip: Chip, cut: Cut, model: ForceModel) -> EdgeForce:
        along = jnp.asarray(cut.vibration_x_m_s)[..., None, None]
        into = jnp.asarray(cut.vibration_y_m_s)[..., None, None]
        plunge = along * jnp.sin(chip.angle_rad) + into * jnp.cos(chip.angle_rad)
        cutting = jnp.pi * jnp.asarray(model.tool.diameter_m) * jnp.asarray(cut.spindle_speed_rev_s)
        speed = jnp.maximum(cutting, _SLOWEST_M_S)[..., None, None]
        radial = self.damping_n_m * chip.width_m * plunge / speed
        return force._replace(edge=force.edge.at[..., 1].add(radial))
