"""Is a named effect the cause of what repeats once a turn, or just a little like it?

Whatever makes teeth unlike each other (a dull sector, a mixed set of inserts) leaves lines at all multiples
of the spindle, and every effect that does the same takes its share of them. The true one takes most; of two
that are there together the larger takes a good part. One that takes little of them, or has to give back at
tooth passing what it takes there, is not the cause.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjx_cutting.tracing.descent import Descent
from mjx_cutting.tracing.fit import Effects
from mjx_cutting.tracing.levels import LEVEL_KINDS
from mjx_cutting.tracing.lines import Lines, order_of_columns
from mjx_cutting.tracing.problem import Problem

_ITS_WORK = 0.5
_LEAST_PART = 0.3


def rather_unlike_teeth(
    problem: Problem, lines: Lines, before: Effects, x_before: ArrayLike, after: Effects, x_after: ArrayLike
) -> str | None:
    """Why an effect is refused that explains little of what repeats once a turn; None where it is not.

    Arguments: problem, lines; the effects and unknowns [U] of the model before, and of the one with the
    candidate.
    """
    teeth = problem.tool.teeth
    if problem.tool.kind in LEVEL_KINDS or teeth < 2:
        return None
    once = order_of_columns(problem.orders) % teeth != 0
    old, new = (_squares(problem, *each) for each in ((before, x_before), (after, x_after)))
    noise = (lines.noise_std_n() * np.asarray(problem.weights)) ** 2
    quiet = float(np.sum(noise[:, None] * np.asarray(problem.present)[:, once, None]))
    there = float(old[:, once].sum()) - quiet
    taken, gained = float((old - new)[:, once].sum()), float((old - new).sum())
    if taken < _ITS_WORK * gained or gained >= _LEAST_PART * there:
        return None
    return f"explains {gained / there:.0%} of what repeats once a turn: the teeth differ in another way"


def _squares(problem: Problem, effects: Effects, x: ArrayLike) -> NDArray[np.floating]:
    """[R, P, 3] squared weighted residual of every line."""
    descent = Descent(problem, effects)
    left = descent.rows(np.asarray(x)[None]).left[0, : descent.measured]
    return np.asarray(left.reshape(problem.whitened.shape) ** 2)
