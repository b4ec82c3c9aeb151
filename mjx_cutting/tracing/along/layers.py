"""Several layers of one sheet, fitted together.

Layers are found one after another, and the first takes what lies beside it for the sheet's own force: of
three levels its own comes out too high or too low by what the others differ. So a further layer is fitted
with those before it, all at their places. Those places, and how wide the borders are, are then settled for
all at once: what a blended border leaves looks like layers of its own to a search for one after another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from mjx_cutting.tracing.along.kind import Kind
from mjx_cutting.tracing.along.shapes import Sums, solve, sums
from mjx_cutting.tracing.records.course import Course

_AT_ONE_PLACE = 0.1
_WIDTHS = (0.05, 0.3)
_EVALUATIONS = 60
_SHARPEST_M = 1e-6
_AGAIN = 3
_HARDLY = 1e-4
Array = NDArray[np.floating]


def columns_of(kind: Kind, course: Course, shapes: Sequence[Array]) -> Array:
    """[T, 3, k] what each coefficient of several `shapes` [d] adds to a trial."""
    return np.concatenate([kind.columns(course, shape) for shape in shapes], axis=-1)


def together(kind: Kind, courses: Sequence[Course], shapes: Sequence[Array]) -> Sums:
    """Sufficient statistics of all `shapes` [d] at once."""
    return sums(lambda course, _: columns_of(kind, course, shapes), courses, np.zeros((1, 1)))


def borders_on(layer: Array, others: Sequence[Array]) -> bool:
    """Whether a layer [start, length, border] ends where one of the `others` begins, or begins where it ends:
    within their borders, which may not be settled yet."""
    start, length, border = layer
    return any(
        min(abs(start + length - other[0]), abs(start - other[0] - other[1]))
        < max(_AT_ONE_PLACE * min(length, other[1]), border, other[2])
        for other in others
    )


def settled(
    stack: Callable[[Array], Sums], layers: Sequence[Array], trials: int, weight: Array
) -> list[Array]:
    """Layers [start, length, border] at the places, and with the width of their borders, all alike, that
    explain most of so many trials together; `stack` is the kind's, of those trials."""
    ends = np.array([(start, start + length) for start, length, _ in layers])
    shortest = float(np.min(ends[:, 1] - ends[:, 0]))
    everyone = np.ones(trials)

    def shapes(x: Array) -> Array:
        at = np.sort(x[1:].reshape(-1, 2), axis=1)
        length = np.maximum(at[:, 1] - at[:, 0], 1e-3 * shortest)
        return np.stack([at[:, 0], length, np.full(len(at), max(np.exp(x[0]), _SHARPEST_M))], axis=1)

    def missed(x: Array) -> float:
        return -float(solve(stack(shapes(x)), everyone, weight)[2][0])

    found = []
    for width in _WIDTHS:
        x = np.append(np.log(width * shortest), ends.ravel())
        step = np.append(0.7, np.full(ends.size, 0.5 * width * shortest))
        least = np.inf
        for _ in range(_AGAIN):
            options = {
                "initial_simplex": np.vstack([x, x + np.diag(step)]),
                "maxfev": _EVALUATIONS * len(x),
                "xatol": 1e-7,
                "fatol": 1e-6,
            }
            best = minimize(missed, x, method="Nelder-Mead", options=options)
            x, gain, least = best.x, least - best.fun, best.fun
            if gain < _HARDLY * abs(least):
                break
        found.append(best)
    return list(shapes(min(found, key=lambda each: float(each.fun)).x))
