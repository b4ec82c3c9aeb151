"""Spindle droop: the motor slows under load, so each tooth takes more and the lines shift.

f = f_0 - T(f) / k, T the mean torque: its edge part does not depend on f, its chip part goes as 1 / f, which
makes a quadratic for f. f_0 is the speed without load, `Cut.spindle_speed_rev_s`; where the data give the
speed under load, there is nothing left to droop. Signature: lines shift with load, the phase walks from the
nominal, the mean rises. Confused with a wrong speed, which is wrong without load too. Its memory is the angle
by which the tool has fallen behind.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.average import mean_load
from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel


@register
class SpindleDroop(AbstractEffect):
    """A motor of finite stiffness.

    Fields: `droop_rev_s_nm` [] 1 / k, loss of speed per torque, rev/s per N m; 0 is rigid. Bound by `recall`:
    `behind_rad` [] angle that the tool has fallen behind, rad.
    """

    name = "spindle_droop"
    stage = "spindle"
    strength = "droop_rev_s_nm"
    parameters = {
        "droop_rev_s_nm": Parameter("rev/s/(N m)", 0.0, 100.0, 0.0, 1.0, source="1-10 % of the speed"),
    }
    coupled = True
    per_turn = True
    signature = "lines shift with load, phase walks, mean rises"
    confused_with = {"wrong spindle speed": "a wrong speed is off without load too"}

    droop_rev_s_nm: ArrayLike
    behind_rad: ArrayLike = 0.0

    def loaded_speed_rev_s(self, cut: Cut, model: ForceModel) -> Array:
        """[...] speed under load, rev/s; a motor past its pull-out torque stays at half of what is left."""
        load = mean_load(model, cut)
        free = jnp.asarray(cut.spindle_speed_rev_s)
        return self.speed_under(free, load.edge_torque, load.chip_torque * free)

    def speed_under(self, free: ArrayLike, edge_torque: ArrayLike, chip_power: ArrayLike) -> Array:
        """[...] speed, rev/s, of a motor that turns at `free` without load, under the torque of the edge,
        N m, and that of the chip times the speed, N m rev/s, which does not depend on it."""
        at_rest = jnp.asarray(free)
        left = jnp.maximum(at_rest - self.droop_rev_s_nm * jnp.asarray(edge_torque), 0.05 * at_rest)
        inner = left**2 - 4.0 * self.droop_rev_s_nm * jnp.asarray(chip_power)
        return 0.5 * (left + jnp.sqrt(jnp.maximum(inner, 1e-6 * left**2 + 1e-12)))

    def spindle(self, cut: Cut, model: ForceModel) -> Cut:
        return cut.replace(
            spindle_speed_rev_s=self.loaded_speed_rev_s(cut, model),
            angle_rad=jnp.asarray(cut.angle_rad) - self.behind_rad,
        )

    def init(self, model: ForceModel) -> Any:
        return jnp.zeros(())

    def recall(self, state: Any, cut: Cut, dt_s: ArrayLike, model: ForceModel) -> SpindleDroop:
        return SpindleDroop(self.droop_rev_s_nm, state)

    def respond(
        self, state: Any, force: Array, cut: Cut, dt_s: ArrayLike, model: ForceModel
    ) -> tuple[Any, Array]:
        lost = jnp.asarray(cut.spindle_speed_rev_s) - self.loaded_speed_rev_s(cut, model)
        return state + 2.0 * jnp.pi * lost * dt_s, force

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[0.3], [3.0]])
