"""Static compliance: the mean force pushes the tool out of the sheet, so it cuts less deep than commanded.

a = max(0, a_cmd + F_y(a) / K), F_y the mean force along the normal (away from the sheet below zero), solved
for the arc by Newton's method; slopes follow from the implicit function theorem. In a full slot the
deflection shifts the slot and leaves the engagement; at the end of a sheet, where teeth meet only the
foremost part of their arc, the wall alone moves. K: impedance control 0.0005-0.02 N/um, cobot 0.02-0.1,
robot 0.1-1. Signature: force concave in load, slow entry, dependent on pose. Confused with the size effect:
change the depth. The simulation's robot deflects by itself: give it this effect only for compliance it does
not have. A force that pulls in deepens the cut, at worst to a full slot. It takes the mean over a
revolution, so it breaks where single teeth move the tool.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.average import mean_load, teeth_alike
from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

_NEWTON = 6
_TIMES = 2
_FULL = 1e-4


@register
class StaticCompliance(AbstractEffect):
    """Deflection along the normal under the mean force.

    Fields: `compliance_m_n` [] 1 / K, m/N; 0 is rigid.
    """

    name = "static_compliance"
    stage = "structure"
    strength = "compliance_m_n"
    parameters = {
        "compliance_m_n": Parameter("m/N", 0.0, 2.5e-3, 0.0, 1e-5, source="K = 0.0005-1 N/um"),
    }
    per_turn = True
    signature = "force concave in load, slow entry, dependent on pose"
    confused_with = {"size_effect": "a sweep of depth bends the law of a compliant structure only"}

    compliance_m_n: ArrayLike

    def engage(self, cut: Cut, force: Callable[[Cut], Array], model: ForceModel) -> Cut:
        radius = 0.5 * jnp.asarray(model.tool.diameter_m)
        entry, exit_ = jnp.asarray(cut.entry_rad), jnp.asarray(cut.exit_rad)
        # an arc that is alike before and behind the axis, of a slot also at the end of a sheet, has no wall
        climb, walled = entry + exit_ > jnp.pi, jnp.abs(entry + exit_ - jnp.pi) > _FULL
        commanded = jnp.asarray(cut.radial_depth_m)
        away = jnp.where(climb, -1.0, 1.0)
        full = jnp.arccos(jnp.clip(1.0 - jax.lax.stop_gradient(commanded) / radius, -1.0, 1.0))
        # at the end of a sheet teeth meet less of the arc, wherever its wall is
        front = jnp.where(climb, jnp.pi - exit_, entry)
        behind = jnp.where(climb, jnp.pi - entry, exit_)
        short = behind < full - _FULL

        def with_arc(swept: Array) -> Cut:
            last = jnp.maximum(jnp.where(short, jnp.minimum(swept, behind), swept), front)
            return cut.replace(
                entry_rad=jnp.where(climb, jnp.pi - last, front),
                exit_rad=jnp.where(climb, jnp.pi - front, last),
                radial_depth_m=radius * (1.0 - jnp.cos(swept)),
            )

        def push(swept: Array, as_alike: bool) -> Array:
            return away * mean_load(model, with_arc(swept), as_alike).force[..., 1]

        def excess(swept: Array, pushed: Array) -> Array:
            return radius * (1.0 - jnp.cos(swept)) - commanded - self.compliance_m_n * pushed

        swept, alike = jnp.clip(full, 1e-6, jnp.pi - _FULL), teeth_alike(model)
        for _ in range(1 if alike else _TIMES):
            # what idle teeth do not push changes little with the depth, and costs much to calculate
            less = 0.0 if alike else push(swept, False) - push(swept, True)
            for _ in range(_NEWTON):
                over, slope = jax.jvp(
                    lambda at, less=less: excess(at, push(at, True) + less), (swept,), (jnp.ones_like(swept),)
                )
                step = over / jnp.maximum(slope, 1e-12)
                swept = jnp.clip(swept - step, 0.2 * swept, jnp.pi - _FULL)
        swept = jax.lax.stop_gradient(swept)
        over, slope = jax.jvp(lambda at: excess(at, push(at, alike)), (swept,), (jnp.ones_like(swept),))
        swept = swept - over / jax.lax.stop_gradient(jnp.maximum(slope, 1e-12))
        swept = jnp.where(commanded > 0.0, jnp.maximum(swept, 0.0), 0.0)
        bent = with_arc(swept)
        return jax.tree.map(lambda old, new: jnp.where(walled, new, old), cut, bent)

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 0 if tool.kind in ("drill", "turning") else 1

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[0.3], [10.0]])
