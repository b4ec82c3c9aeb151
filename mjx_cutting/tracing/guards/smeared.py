"""Are lines weaker because something takes from them, or because the spindle turns unevenly?

A spindle whose angle wanders by sigma turns line n by n sigma to and fro: of its energy the share (n sigma)^2
goes from the line to its sides, and the higher orders lose most, as under a helix or a low-pass filter. But
these destroy what a wander only moves. So where as much lies between the lines as the effect takes from them,
it has lost nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import Effects
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.records.lines import Lines

_SHARE = 0.5


def rather_smeared(problem: Problem, lines: Lines, effects: Effects, x: ArrayLike) -> str | None:
    """Why the last of `effects` is refused, whose losses are found beside the lines; None where they are not.

    Arguments: problem and lines of the trials; `x` [U] unknowns of the model with all `effects`.
    """
    kind, known = effects[-1], np.asarray(x)
    if not kind.damps:
        return None
    bare = known[: len(known) - kind.size(problem.tool)]
    without, with_it = (
        float(np.sum(Descent(problem, each).mark(at[None]) ** 2))
        for each, at in ((effects[:-1], bare), (effects, known))
    )
    beside, lost = float(np.sum(lines.rest_n2 * np.asarray(problem.weights) ** 2)), without - with_it
    if lost <= 0.0 or beside < _SHARE * lost:
        return None
    return (
        f"{beside / lost:.1f} times the energy that it takes from the lines lies between them: nothing is "
        "lost, as under a spindle that turns unevenly"
    )
