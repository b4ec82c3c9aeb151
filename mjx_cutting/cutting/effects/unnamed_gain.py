"""Unnamed gain: a factor on the cutting force that follows the conditions of the cut, whatever the reason.

(1 + sum over conditions c of f_c(c)) (k_c h + k_e): f_c is straight between three knots, nil at the first and
constant beyond the last. It is no physics. Where the residual goes with a condition and no effect of the
library explains it, tracing fits this term, so that the model is right where it was measured, and says that
it is unnamed; outside the range of the trials it says nothing. Confused with everything that makes all the
force of a trial larger or smaller: wear, softening, drift of an amplifier.
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

CONDITIONS = (
    "feed",
    "spindle speed",
    "feed with spindle speed",
    "radial depth",
    "cut length",
    "clock time",
)
KNOTS = 3
_USUAL = np.array([5e-3, 20.0, 0.1, 3e-3, 3.0, 300.0])
"""Usual values of the conditions, in SI units."""


def conditions(cut: Cut) -> Array:
    """[..., 6] the `CONDITIONS` of a cut, in SI units; feed with spindle speed is their product."""
    feed, speed = jnp.asarray(cut.feed_speed_m_s), jnp.asarray(cut.spindle_speed_rev_s)
    values = (feed, speed, feed * speed, cut.radial_depth_m, cut.cut_length_m, cut.clock_s)
    return jnp.stack(jnp.broadcast_arrays(*map(jnp.asarray, values)), axis=-1)


@register
class UnnamedGain(AbstractEffect):
    """A factor on the force over the conditions of the cut, of unknown cause.

    Fields: `gain` [12] f_c at the second and third knot of each of the six `CONDITIONS`; `knots` [18] the
    three of each, increasing, in SI units; a condition with equal knots has no part in it.
    """

    name = "unnamed_gain"
    stage = "edge"
    physical = False
    strength = "gain"
    alike = True
    parameters = {
        "gain": Parameter(
            "1", -0.95, 20.0, 0.0, 0.1, length=(KNOTS - 1) * len(CONDITIONS), source="no physics: fitted"
        ),
        "knots": Parameter(
            "1", -1e9, 1e9, None, 1.0, length=KNOTS * len(CONDITIONS), source="range of the trials"
        ),
    }
    signature = "all the force of a trial larger or smaller, going with a condition of the cut"
    confused_with = {"flank_wear": "wear is monotone in cut length and resets at a tool change"}

    gain: ArrayLike
    knots: ArrayLike

    def edge(self, force: EdgeForce, chip: Chip, cut: Cut, model: ForceModel) -> EdgeForce:
        knot = jnp.asarray(self.knots).reshape(-1, KNOTS)
        at = conditions(cut)[..., None]
        span = knot[:, 1:] - knot[:, :-1]
        share = jnp.clip((at - knot[:, :-1]) / jnp.where(span > 0.0, span, 1.0), 0.0, 1.0)
        value = jnp.asarray(self.gain).reshape(-1, KNOTS - 1)
        rise = jnp.where(span > 0.0, jnp.diff(value, axis=-1, prepend=0.0), 0.0)
        factor = (1.0 + jnp.sum(share * rise, axis=(-2, -1)))[..., None, None, None]
        return EdgeForce(chip=force.chip * factor, edge=force.edge * factor)

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> UnnamedGain:
        values = (KNOTS - 1) * len(CONDITIONS)
        typical = cls.parameters["gain"].typical
        return UnnamedGain(typical * coordinates[:values], np.repeat(_USUAL, KNOTS) * coordinates[values:])

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        gain = np.full((KNOTS - 1) * len(CONDITIONS), 0.3)
        return np.concatenate([gain, np.tile(np.arange(KNOTS), len(CONDITIONS))])[None]
