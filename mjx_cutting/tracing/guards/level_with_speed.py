"""Does the sensor's zero creep with the clock, or does a level go with the speed of the spindle?

Windage, coolant flung off, a spindle that warms the same way at each speed: what is there in air too and is a
level of its own at each speed looks like a drift where speeds were cut one after another. A drift passes
only where a level that follows the speed, c f + d f^2 on each axis, does not leave less.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting import AbstractEffect, Cut, ForceModel
from mjx_cutting.cutting.effects import Parameter
from mjx_cutting.cutting.effects.thermal_drift import ThermalDrift
from mjx_cutting.tracing.guards.gain import Gain

_USUAL_REV_S = 30.0
_TERMS = 2


class LevelWithSpeed(AbstractEffect):
    """Levels over the spindle's speed, of unknown cause.

    Fields: `level_n` [6] at 30 rev/s, N: what grows with the speed on each axis, then with its square.
    """

    name = "level_with_speed"
    stage = "sensor"
    physical = False
    strength = "level_n"
    parameters: ClassVar[dict[str, Parameter]] = {
        "level_n": Parameter("N", -1e4, 1e4, 0.0, 1.0, length=3 * _TERMS, source="no physics: fitted")
    }

    level_n: ArrayLike

    def sense(self, force: Array, cut: Cut, model: ForceModel) -> Array:
        speed = jnp.asarray(cut.spindle_speed_rev_s)[..., None] / _USUAL_REV_S
        first, second = jnp.split(jnp.asarray(self.level_n), _TERMS)
        return force + first * speed + second * speed**2


def rather_with_speed(gain: Gain) -> str | None:
    """Why a drift is refused that levels over the speed do better than; None where it is not, or is none."""
    problem = gain.problem
    if gain.kind is not ThermalDrift or np.ptp(np.asarray(problem.cut.spindle_speed_rev_s)) == 0.0:
        return None
    left = gain.squares_with(LevelWithSpeed)
    if left >= float(gain.found.squares):
        return None
    ratio = float(gain.found.squares) / max(left, 1e-300)
    return f"a level that follows the spindle's speed, in air as in the cut, leaves {ratio:.1f} times less"
