"""Is a layer of less force at an end of the paths a softer layer, or a tool not yet fully in the sheet?

A tool that enters or leaves is short of force too, but the less the deeper in it is: its arc fills over some
way; in the air all is missing. A softer layer is short by the same share all the way to its border. So one
that reaches the end of the paths passes only where an even share, of less than half of the force, explains
more than any that fades. And of a layer that shows one border only, and that so wide that the force is even
on one side of it nowhere, nothing is left but a slope: force that changes evenly with the place.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.records.course import Course

_NEAR = 0.01
_AIR = 0.5
_LONGER = (1.0, 1.5, 2.0, 3.0)
_POWERS = (1.0, 2.0)
_SURELY = 1.05
_EVEN_BESIDE = 0.5
Array = NDArray[np.floating]


def at_the_end(courses: Sequence[Course], layer: AbstractEffect) -> str:
    """Why a `layer` fitted to `courses` is refused that may be a tool not yet, or no more, fully in the
    sheet; empty where it is not."""
    change, start, length = (float(layer.values()[name]) for name in ("change", "start_m", "length_m"))
    low = min(float(each.position_m.min()) for each in courses)
    high = max(float(each.position_m.max()) for each in courses)
    near = _NEAR * (high - low)
    first, last = start < low + near, start + length > high - near
    if change >= 0.0 or not (first or last) or length >= 0.5 * (high - low):
        return ""
    reach = start + length - low if first else high - start
    ways = [each.position_m - low if first else high - each.position_m for each in courses]
    if change > -_AIR and _even(courses, ways, reach):
        return ""
    side = "first" if first else "last"
    return (
        f"force is missing over the {side} {1e3 * length:.1f} mm of the path: the tool enters or leaves the "
        "sheet there; cut the records down to where it is engaged"
    )


def rather_a_slope(courses: Sequence[Course], layer: AbstractEffect) -> str:
    """Why a `layer` with its border settled is refused that is but a slope along the paths of `courses`;
    empty where it is not."""
    start, length, border = (float(layer.values()[name]) for name in ("start_m", "length_m", "border_m"))
    low = min(float(each.position_m.min()) for each in courses)
    high = max(float(each.position_m.max()) for each in courses)
    first, last = start - 0.5 * border, start + length + 0.5 * border
    within = min(last - border, high) - max(first + border, low)
    beyond = max(first - low, high - last)
    both_show = first > low and last < high
    if both_show or min(within, beyond) > _EVEN_BESIDE * border:
        return ""
    return (
        f"its one border that shows is {1e3 * border:.3g} mm wide, and on one side of it the force is even "
        "nowhere: it changes evenly with the place"
    )


def _even(courses: Sequence[Course], ways_m: Sequence[Array], reach_m: float) -> bool:
    """Whether what is missing within `reach_m` of an end, `ways_m` [T] away from it, is an even share of the
    force rather than one that fades."""
    even = _taken(courses, [(way < reach_m).astype(float) for way in ways_m])
    fading = max(
        _taken(courses, [np.clip(1.0 - way / (longer * reach_m), 0.0, 1.0) ** power for way in ways_m])
        for longer in _LONGER
        for power in _POWERS
    )
    return even > _SURELY * fading


def _taken(courses: Sequence[Course], shares: Sequence[Array]) -> float:
    """By how much `shares` [T] of the force, beside a bias, lower the squared error, N^2."""
    product = size = 0.0
    for course, share in zip(courses, shares, strict=True):
        column = share[:, None] * course.force(1.0)
        column = column - column.mean(axis=0)
        product += float(np.sum(column * course.left_n))
        size += float(np.sum(column**2))
    return product**2 / max(size, 1e-300)
