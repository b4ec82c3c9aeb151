"""Does an edge wear, or a zero creep, or did something change all at once?

Coolant that is switched off, an edge that chips, a cable that is moved, a bar of another batch: from one cut
to the next the force on the edge, the sensor's zero or all of the force is another and stays so. Three
quarters of the energy of such a step are in the straight line through it, which wear and drift follow. So
they pass only where no step between two cuts leaves much less. Where all cuts are of one width, the force on
the edge and the zero jump alike, and both are told.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect, Cut, ForceModel
from mjx_cutting.cutting.chip import Chip
from mjx_cutting.cutting.effects import Parameter
from mjx_cutting.cutting.effects.abstract import EdgeForce
from mjx_cutting.cutting.effects.flank_wear import FlankWear
from mjx_cutting.cutting.effects.thermal_drift import ThermalDrift
from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.guards.gain import Gain

_MUCH_LESS = 0.5
_TIED = 1.05
_MOST_PLACES = 32
_LOWEST = 3
_STEPS = 3
_ONSET = Parameter("1", -1e9, 1e9, source="given")
_ORDERS = {"clock_s": "s of the clock", "cut_length_m": "m of length cut"}


class Step(AbstractEffect):
    """What is there from some time on, of unknown cause.

    Fields: `change` [3] of each direction, or [1] of all; `onset` [] where it begins, in the field `of` of
    `Cut`, which is given: nothing moves with it between two cuts.
    """

    strength = "change"
    physical = False
    of: ClassVar[str]

    change: ArrayLike
    onset: ArrayLike

    def there(self, cut: Cut) -> Array:
        """[..., 3] the change at an instant, or [..., 1]."""
        on = jnp.asarray(getattr(cut, self.of)) > self.onset
        return jnp.where(on[..., None], jnp.asarray(self.change), 0.0)


class StepOfTheZero(Step):
    """A sensor's zero that jumps, N."""

    name = "step_of_the_zero"
    stage = "sensor"
    parameters: ClassVar[dict[str, Parameter]] = {
        "change": Parameter("N", -1e5, 1e5, 0.0, 10.0, length=3, source="no physics: fitted"),
        "onset": _ONSET,
    }

    def sense(self, force: Array, cut: Cut, model: ForceModel) -> Array:
        return force + self.there(cut)


class StepOfTheGain(Step):
    """A factor on all of the force that jumps."""

    name = "step_of_the_gain"
    stage = "sensor"
    parameters: ClassVar[dict[str, Parameter]] = {
        "change": Parameter("1", -1.0, 1e2, 0.0, 0.1, length=1, source="no physics: fitted"),
        "onset": _ONSET,
    }

    def sense(self, force: Array, cut: Cut, model: ForceModel) -> Array:
        return force * (1.0 + self.there(cut))


class StepOfTheEdge(Step):
    """A force on the edge that jumps, N/m."""

    name = "step_of_the_edge"
    stage = "edge"
    alike = True
    parameters: ClassVar[dict[str, Parameter]] = {
        "change": Parameter("N/m", -1e8, 1e8, 0.0, 1e4, length=3, source="no physics: fitted"),
        "onset": _ONSET,
    }

    def edge(self, force: EdgeForce, chip: Chip, cut: Cut, model: ForceModel) -> EdgeForce:
        more = chip.width_m[..., None] * self.there(cut)[..., None, None, :]
        return force._replace(edge=force.edge + more)


_TRIED = (StepOfTheZero, StepOfTheGain, StepOfTheEdge)


def rather_sudden(gain: Gain) -> str | None:
    """Why wear or a drift is refused where a step between two cuts leaves much less; None where none does,
    or where it is neither."""
    if not issubclass(gain.kind, FlankWear | ThermalDrift):
        return None
    cut = gain.problem.cut
    of = next((each for each in _ORDERS if np.ptp(np.asarray(getattr(cut, each))) > 0.0), None)
    if of is None:
        return None
    when = np.unique(np.asarray(getattr(cut, of)))
    onsets = 0.5 * (when[1:] + when[:-1])
    onsets = onsets[np.unique(np.linspace(0, len(onsets) - 1, _MOST_PLACES).astype(int))]
    slope = Descent(gain.problem, gain.others).around(gain.rest)[1]
    tried = [(*_least(gain, slope, step, of, onsets), step) for step in _TRIED]
    squares, onset, _ = min(tried, key=lambda each: each[0])
    if squares >= _MUCH_LESS * float(gain.found.squares):
        return None
    of_what = [
        step.name.removeprefix("step_").replace("_", " ")
        for left, _, step in tried
        if left <= _TIED * squares
    ]
    ratio = float(gain.found.squares) / max(squares, 1e-300)
    return f"a step {' or '.join(of_what)} at {onset:.4g} {_ORDERS[of]} leaves {ratio:.3g} times less"


def _least(
    gain: Gain, slope: NDArray[np.floating], step: type[Step], of: str, onsets: NDArray[np.floating]
) -> tuple[float, float]:
    """Squares that a step beside the others leaves, at the onset where they are least, and that onset: of
    those that a first step in the unknowns, along the others' `slope` [M + B, U'], brings lowest."""
    descent = Descent(gain.problem, (*gain.others, type(step.__name__, (step,), {"of": of})))
    changes = np.zeros(step.size(gain.problem.tool) - 1)
    starts = np.stack([np.concatenate([gain.rest, changes, [onset]]) for onset in onsets])
    lowest = np.argsort(descent.glance(starts, slope))[:_LOWEST]
    reached = np.stack([descent.descend(starts[each], _STEPS)[0] for each in lowest])
    squares = descent.squares_left(reached)
    best = int(np.argmin(squares))
    return float(squares[best]), float(onsets[lowest[best]])
