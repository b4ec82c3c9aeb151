"""Side friction: the faces of the blade rub on the walls of the kerf.

F = mu p A against the motion of the tool, A = 2 faces x R^2 (psi - sin psi) / 2, psi = 2 acos(1 - a / R); and
a torque mu p x integral of r over the same area. Only the product mu p can be told. Signature: a constant
force along the motion that grows with the engaged AREA, not with feed or number of teeth. Confused with the
edge constant, which grows with the arc (sweep the depth), and with a bias of the sensor (cut air).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.engagement import arc
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

_SLOW_M_S = 1e-5


@register
class SideFriction(AbstractEffect):
    """Friction on both faces of a blade.

    Fields: `drag_pa` [] mu p, friction coefficient times pressure, Pa.
    """

    name = "side_friction"
    stage = "tool"
    strength = "drag_pa"
    parameters = {
        "drag_pa": Parameter("Pa", 0.0, 1e5, 0.0, 2e3, source="mu 0.1-0.4, p 1-100 kPa"),
    }
    signature = "constant force along the motion that grows with engaged area, not with feed or teeth"
    confused_with = {
        "edge constant": "the edge force grows with the arc, this with the area: sweep the depth",
        "sensor bias": "a bias shows in air",
    }

    drag_pa: ArrayLike

    def body(self, force: Array, cut: Cut, model: ForceModel) -> Array:
        area = _segment(model, cut)[0]
        towards = jnp.tanh(jnp.asarray(cut.feed_speed_m_s) / _SLOW_M_S)
        drag = -jnp.asarray(self.drag_pa) * area * towards
        still = jnp.zeros_like(drag)
        return force + jnp.stack([drag, still, still], axis=-1)

    def brake(self, torque: Array, cut: Cut, model: ForceModel) -> Array:
        return torque + self.drag_pa * _segment(model, cut)[1]

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 0 if tool.kind in ("drill", "turning") else 1

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[1.0]])


def _segment(model: ForceModel, cut: Cut) -> tuple[Array, Array]:
    """Area [...] m^2 of both faces inside the sheet, and the integral of the radius over it, m^3."""
    radius = 0.5 * jnp.asarray(model.tool.diameter_m)
    half = arc("conventional", cut.radial_depth_m, model.tool.diameter_m)[1]
    area = radius**2 * (2.0 * half - jnp.sin(2.0 * half))
    shallow = jnp.minimum(half, jnp.pi - half)
    cosine = jnp.maximum(jnp.cos(shallow), 1e-4)
    secant, tangent = 1.0 / cosine, jnp.sin(shallow) / cosine
    cubed = secant * tangent + jnp.log(secant + tangent)
    moment = 2.0 / 3.0 * radius**3 * (2.0 * shallow - cosine**3 * cubed)
    whole = 4.0 / 3.0 * jnp.pi * radius**3
    return area, jnp.where(half > 0.5 * jnp.pi, whole - moment, moment)
