"""Does a force that turns with the spindle go with the square of its speed, or is it as large at any?

What the cut itself repeats once a turn (under a dull or a chipped tooth, say) is of a size that has nothing
to do with the speed, and is taken for an unbalance where it turns like one. An unbalance passes only where a
line of the spindle on both radial axes, the same at every speed, does not leave clearly less. A runout's line
is as large at any speed too, but of one shape along the axes, and it comes with lines at the other multiples
of the spindle; one that leaves twice what such a line leaves is not what turns.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting import AbstractEffect, Cut, ForceModel
from mjx_cutting.cutting.effects import Parameter
from mjx_cutting.cutting.effects.radial_runout import RadialRunout
from mjx_cutting.cutting.effects.unbalance import Unbalance
from mjx_cutting.tracing.guards.gain import Gain
from mjx_cutting.tracing.records.levels import LEVEL_KINDS

_CLEARLY = 10.0
_PART = 0.1
_TIMES = 2.0


class TurningForce(AbstractEffect):
    """A line of the spindle that is the same at any speed, of unknown cause.

    Fields: `amplitude_n` [4] N: of sin and cos of the tool's angle along x, then along y.
    """

    name = "turning_force"
    stage = "tool"
    physical = False
    strength = "amplitude_n"
    parameters: ClassVar[dict[str, Parameter]] = {
        "amplitude_n": Parameter("N", -1e4, 1e4, 0.0, 1.0, length=4, source="no physics: fitted")
    }

    amplitude_n: ArrayLike

    def body(self, force: Array, cut: Cut, model: ForceModel) -> Array:
        angle = jnp.asarray(cut.angle_rad)[..., None]
        sine, cosine = jnp.split(jnp.reshape(jnp.asarray(self.amplitude_n), (2, 2)).T, 2)
        plane = sine[0] * jnp.sin(angle) + cosine[0] * jnp.cos(angle)
        return force + jnp.concatenate([plane, jnp.zeros_like(angle)], axis=-1)


def rather_at_any_speed(gain: Gain) -> str | None:
    """Why an unbalance, or a runout of a milling tool, is refused that a line of the same size at every speed
    does better than; None where it does not, or it is neither."""
    problem = gain.problem
    speeds_differ = np.ptp(np.asarray(problem.cut.spindle_speed_rev_s)) > 0.0
    unbalance = gain.kind is Unbalance and speeds_differ
    runout = gain.kind is RadialRunout and problem.tool.kind not in LEVEL_KINDS
    if not (unbalance or runout):
        return None
    left, found = gain.squares_with(TurningForce), float(gain.found.squares)
    if found - left <= max(_CLEARLY, _PART * (float(gain.before.squares) - found)):
        return None
    ratio = found / max(left, 1e-300)
    if runout and ratio < _TIMES:
        return None
    return f"a line of the spindle that is as large at any speed leaves {ratio:.1f} times less"
