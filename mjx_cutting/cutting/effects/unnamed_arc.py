"""Unnamed arc: a factor on the cutting force that follows the angle of the edge, whatever the reason.

(1 + sum over k of a_k cos(k th)) (k_c h + k_e), k = 1 to 4, with a_k of each direction's own. It is no
physics. Where what is left repeats with the teeth and no effect of the library explains it, tracing fits this
term, so that the model is right where it was measured, and says that it is unnamed; on an arc that no trial
cut it says nothing. A sheet whose strength goes with the direction of cutting (rolled, of fibres) is like
that. Confused with what shapes the force under a tooth: the edge law, compliance, a filter.
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

HARMONICS = 4


def along_arc(gain: ArrayLike, angle_rad: ArrayLike) -> Array:
    """[..., 3] factors on tangential, radial and axial force at angles [...] of the edge."""
    waves = jnp.cos(jnp.asarray(angle_rad)[..., None] * jnp.arange(1, HARMONICS + 1))
    return 1.0 + waves @ jnp.asarray(gain).reshape(3, HARMONICS).T


@register
class UnnamedArc(AbstractEffect):
    """A factor on the force along the arc, of unknown cause.

    Fields: `gain` [12] a_k of the tangential force, k from 1 to 4, then of the radial and the axial.
    """

    name = "unnamed_arc"
    stage = "edge"
    physical = False
    strength = "gain"
    parameters = {
        "gain": Parameter("1", -5.0, 5.0, 0.0, 0.1, length=3 * HARMONICS, source="no physics: fitted"),
    }
    signature = "the force under a tooth larger on one part of the arc, smaller on another, at every feed"
    confused_with = {"sensor_lowpass": "a filter goes with frequency: change the speed"}

    gain: ArrayLike

    def edge(self, force: EdgeForce, chip: Chip, cut: Cut, model: ForceModel) -> EdgeForce:
        factor = along_arc(self.gain, chip.angle_rad)
        return EdgeForce(chip=force.chip * factor, edge=force.edge * factor)
