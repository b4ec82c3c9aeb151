"""Does a worn edge or a drifting zero add to the force, or is all of it multiplied?

A transducer whose gain changes as it warms, a sheet that hardens or softens: all of the force grows or falls
with time. Wear (a force on the edge, whatever the feed) and drift (one in air too) follow that in part. So
they pass only where a factor that grows with the clock or with the length cut, 1 + g (1 - exp(-u / tau)),
does not leave much less.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting import AbstractEffect, Cut, ForceModel
from mjx_cutting.cutting.effects import Parameter
from mjx_cutting.cutting.effects.flank_wear import FlankWear
from mjx_cutting.cutting.effects.thermal_drift import ThermalDrift
from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.guards.gain import Gain

_MUCH_LESS = 0.5
_STARTS = (0.1, 0.4, 3.0)
_FIRST_STEPS = 4
_STEPS = 20
_GROWS_WITH = {"clock_s": "the clock", "cut_length_m": "the length cut"}


class GainWithTime(AbstractEffect):
    """A factor on all of the force that grows with a field of `Cut`, of unknown cause.

    Fields: `gain` [] that is reached in the end; `tau` [] how soon, as a share of the `longest`.
    """

    name = "gain_with_time"
    stage = "sensor"
    physical = False
    strength = "gain"
    parameters: ClassVar[dict[str, Parameter]] = {
        "gain": Parameter("1", -1.0, 10.0, 0.0, 0.1, source="no physics: fitted"),
        "tau": Parameter("1", 0.01, 100.0, None, 1.0, log=True, source="no physics: fitted"),
    }
    of: ClassVar[str]
    longest: ClassVar[float]

    gain: ArrayLike
    tau: ArrayLike

    def sense(self, force: Array, cut: Cut, model: ForceModel) -> Array:
        grown = -jnp.expm1(-jnp.asarray(getattr(cut, self.of)) / (self.longest * jnp.asarray(self.tau)))
        return force * (1.0 + self.gain * grown)[..., None]


def rather_multiplied(gain: Gain) -> str | None:
    """Why wear or a drift is refused where a factor on all of the force that grows with the clock or the
    length cut leaves much less; None where it does not, or where it is neither."""
    if not issubclass(gain.kind, FlankWear | ThermalDrift):
        return None
    for of, what in _GROWS_WITH.items():
        longest = float(np.max(np.asarray(getattr(gain.problem.cut, of))))
        if not longest > 0.0:
            continue
        grown = type("GainWithTime", (GainWithTime,), {"of": of, "longest": longest})
        descent = Descent(gain.problem, (*gain.others, grown))
        starts = [np.concatenate([gain.rest, [0.3, np.log(tau)]]) for tau in _STARTS]
        x = min((descent.descend(start, _FIRST_STEPS) for start in starts), key=lambda each: each[1])[0]
        left = float(descent.squares_left(descent.descend(x, _STEPS)[0][None])[0])
        if left < _MUCH_LESS * float(gain.found.squares):
            ratio = float(gain.found.squares) / max(left, 1e-300)
            return f"a factor on all of the force that grows with {what} leaves {ratio:.3g} times less"
    return None
