"""Tool gravity: a sensor between flange and tool carries the tool's weight and feels its acceleration.

F + m (g - a), in process axes; g - a is in `Cut.gravity_x_m_s2` and its sisters. Signature: a constant force
by pose and spikes where the arm accelerates, in air too. Confused with drift: change the pose. Needs the
tool's orientation; zeroing the sensor in another pose leaves the difference of the two.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.registry import register

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel


@register
class ToolGravity(AbstractEffect):
    """Mass beyond the sensor.

    Fields: `mass_kg` [] m, kg.
    """

    name = "tool_gravity"
    stage = "sensor"
    strength = "mass_kg"
    parameters = {"mass_kg": Parameter("kg", 0.0, 20.0, 0.0, 1.0, source="0.3-3 kg")}
    needs = ("tool orientation",)
    signature = "constant force by pose, spikes at accelerations, in air too"
    confused_with = {"thermal_drift": "drift does not follow the pose"}

    mass_kg: ArrayLike

    def sense(self, force: Array, cut: Cut, model: ForceModel) -> Array:
        fall = (cut.gravity_x_m_s2, cut.gravity_y_m_s2, cut.gravity_z_m_s2)
        return force + self.mass_kg * jnp.stack(jnp.broadcast_arrays(*map(jnp.asarray, fall)), axis=-1)
