"""Several layers of one sheet, their strengths fitted together.

Layers are found one after another, and the first takes what lies beside it for the sheet's own force: of
three levels its own comes out too high or too low by what the others differ. So a further layer is fitted
with those before it, all at their places.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.along.kind import Kind
from mjx_cutting.tracing.along.shapes import Sums, sums
from mjx_cutting.tracing.records.course import Course

_AT_ONE_PLACE = 0.1
Array = NDArray[np.floating]


def columns_of(kind: Kind, course: Course, shapes: Sequence[Array]) -> Array:
    """[T, 3, k] what each coefficient of several `shapes` [d] adds to a trial."""
    return np.concatenate([kind.columns(course, shape) for shape in shapes], axis=-1)


def together(kind: Kind, courses: Sequence[Course], shapes: Sequence[Array]) -> Sums:
    """Sufficient statistics of all `shapes` [d] at once."""
    return sums(lambda course, _: columns_of(kind, course, shapes), courses, np.zeros((1, 1)))


def borders_on(layer: Array, others: Sequence[Array]) -> bool:
    """Whether a layer [start, length] ends where one of the `others` begins, or begins where it ends."""
    start, length = layer
    return any(
        min(abs(start + length - other[0]), abs(start - other[0] - other[1]))
        < _AT_ONE_PLACE * min(length, other[1])
        for other in others
    )
