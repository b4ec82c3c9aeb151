"""By how much of itself the force of each tooth is larger than predicted, as a whole.

No two teeth are ground, set or worn quite alike: each cuts with a force larger or smaller by a hundredth than
the next. That repeats with the turns of the spindle, and is no shape that the model lacks, nor does any other
tool of the kind share it. So what repeats with the turns is looked for in what is left without it, where it
is small, as a factor of each trial's own is (`own_factor`). A runout, a pitch or a broken tooth is named
before that, where the trials tell it from such teeth (`guards.unlike_teeth`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from scipy import stats

from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import Effects
from mjx_cutting.tracing.fitting.prediction import Prediction, energy, predictions
from mjx_cutting.tracing.fitting.problem import Problem, model_at, shared_bias
from mjx_cutting.tracing.guards.unlike_teeth import UnlikeTeeth
from mjx_cutting.tracing.naming.search import Search
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import Lines
from mjx_cutting.tracing.telling.own_factor import SCATTER
from mjx_cutting.trials.dataset import Dataset

_STEPS = 12
_SURELY = 1e-3


@dataclass(frozen=True, eq=False)
class OwnTeeth:
    """A share of its own for each tooth.

    Fields: `size` root mean square of the shares; `share` of the energy left that they are; `without` them,
    the predictions.
    """

    size: float
    share: float
    without: tuple[Prediction, ...]

    def __str__(self) -> str:
        return (
            f"the force of each tooth is larger or smaller as a whole, by {self.size:.1%} ({self.share:.0%} "
            f"of what was left): below {SCATTER:.1%} that counts as scatter"
        )


def own_teeth(dataset: Dataset, lines: Lines, found: Search, after: Sequence[Prediction]) -> OwnTeeth | None:
    """The teeth's own shares, where they are beyond chance and no more than what two cuts of one sheet may
    differ by; else None (call it in float64).

    Arguments: the trials and their lines; the outcome of the search over steady effects; every cut trial
        beside the prediction of all that was found.
    """
    problem, effects, x = found.problem, found.effects, np.asarray(found.final_fit.x)
    if problem.tool.kind in LEVEL_KINDS or problem.tool.teeth < 2 or problem.motion is not None:
        return None
    kinds: Effects = (*effects, UnlikeTeeth)
    descent, unknown = Descent(problem, kinds), UnlikeTeeth.size(problem.tool)
    start = np.append(x, np.zeros(unknown))
    there, _ = descent.descend(start, _STEPS)
    squares, fewer = descent.squares_left(np.stack([start, there]))
    free = max(int(problem.whitened.size) - len(there), 1)
    if stats.f.sf((squares - fewer) / unknown / max(fewer / free, 1e-300), unknown, free) > _SURELY:
        return None
    model = model_at(problem, jnp.asarray(there), kinds)
    shares = next(each.share for each in model.effects if isinstance(each, UnlikeTeeth))
    size = float(np.sqrt(np.mean(np.asarray(shares) ** 2)))
    if size > SCATTER:
        return None
    ways = ((model, there), (model_at(problem, jnp.asarray(x), effects), x))
    apart, alike = (predictions(dataset, lines, problem, each, _bias(problem, at)) for each, at in ways)
    without = tuple(
        replace(each, predicted_n=each.predicted_n + one.predicted_n - other.predicted_n)
        for each, one, other in zip(after, apart, alike, strict=True)
    )
    left_n2, rest_n2 = (energy([each.residual_n for each in some]) for some in (after, without))
    return None if rest_n2 >= left_n2 else OwnTeeth(size, 1.0 - rest_n2 / left_n2, without)


def _bias(problem: Problem, x: np.ndarray) -> np.ndarray:
    return np.asarray(shared_bias(problem, jnp.asarray(x)))
