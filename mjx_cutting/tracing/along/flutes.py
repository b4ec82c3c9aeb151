"""Clogging of a drill: the flutes fill with the chip of the hole, and pressing more into them takes force.

What has been cut since the hole began is the feed per tooth times its depth. Beyond what a flute holds, force
and torque rise in proportion: at a large feed from a small depth on, at a small one from a large depth. That
tells it from a layer, which begins at one depth at every feed, and from what takes the same time.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect, effect_class
from mjx_cutting.tracing.along.kind import Kind, listed
from mjx_cutting.tracing.along.shapes import Sums, profiled_sums, solve
from mjx_cutting.tracing.records.course import Course, at_several_feeds

NAME = "clogging"
_CAPACITIES = 48
_LEAST, _MOST = 0.05, 0.95
_CLOSER = 13
_AS_GOOD = 0.9
Array = NDArray[np.floating]


def of_a_drill(courses: Sequence[Course]) -> bool:
    """Whether the trials are holes, of which the torque crosses a border one lip after the other."""
    return any(np.ptp(each.border_power) > 0.0 for each in courses)


def cut_since(course: Course) -> Array:
    """[T] area of chip that a tooth has cut since the hole began, m^2."""
    feed_m_s = float(np.ptp(course.position_m)) / max(float(np.ptp(course.time_s)), 1e-9)
    return feed_m_s * course.pitch_s * np.maximum(course.position_m, 0.0)


def _capacities(courses: Sequence[Course]) -> Array:
    """[P, 2] what a flute holds, m^2, from a small part of what the longest hole at the largest feed fills it
    with up to nearly all; and the share of the edge's force that rises with the chip's."""
    known = effect_class(NAME).parameters["capacity_m2"]
    most = max(float(cut_since(each).max()) for each in courses)
    low, high = max(_LEAST * most, known.low), min(_MOST * most, known.high)
    if low >= high:
        return np.zeros((0, 2))
    return np.array([(each, share) for share in (1.0, 0.0) for each in np.geomspace(low, high, _CAPACITIES)])


def _near(shapes: Array, here: Array, zoom: float) -> Array:
    step = np.log(shapes[1, 0] / shapes[0, 0]) if len(shapes) > 1 else 0.05
    near = here[0] * np.exp(step / zoom * np.linspace(-1.0, 1.0, _CLOSER))
    return np.array([(each, share) for share in (1.0, 0.0) for each in near])


def _overfill(area_m2: Array, capacity_m2: Array) -> Array:
    """[P, T, 3] by how much more than full a flute of each capacity [P] is, at areas [T]."""
    over = np.maximum(area_m2 / capacity_m2[:, None] - 1.0, 0.0)
    return np.broadcast_to(over[..., None], (*over.shape, 3))


def _columns(course: Course, shape: Array) -> Array:
    over = _overfill(cut_since(course), shape[:1])[0]
    return np.asarray((over * course.force(float(shape[1])))[..., None])


def _sums(courses: Sequence[Course], shapes: Array) -> Sums:
    parts, places = [], []
    for share in np.unique(shapes[:, 1]):
        here = np.flatnonzero(shapes[:, 1] == share)

        def carrier(course: Course, share: float = float(share)) -> Array:
            return course.force(share)[..., None]

        parts.append(profiled_sums(courses, cut_since, carrier, _profile, shapes[here]))
        places.append(here)
    order = np.argsort(np.concatenate(places))
    sides = zip(*((each.square, each.product) for each in parts), strict=True)
    square, product = (np.concatenate(side, axis=1)[:, order] for side in sides)
    return Sums(square, product)


def _profile(area_m2: Array, shapes: Array) -> Array:
    return _overfill(area_m2, shapes[:, 0])


def _effect(shape: Array, c: Array) -> AbstractEffect:
    return effect_class(NAME)(gain=float(c[0]), capacity_m2=float(shape[0]), edge_share=float(shape[1]))


def _parts(effect: AbstractEffect) -> tuple[Array, Array]:
    return listed(effect, "capacity_m2", "edge_share"), listed(effect, "gain")


def rather_in_time(courses: Sequence[Course], effect: AbstractEffect) -> str:
    """Why clogging is refused where a force that rises from one time on at every feed explains as much; ""
    where that does not."""
    shape, _ = _parts(effect)
    longest = max(float(each.time_s[-1]) for each in courses)
    times = longest * np.linspace(0.0, _MOST, _CAPACITIES)[:, None]

    def carrier(course: Course) -> Array:
        return course.force(float(shape[1]))[..., None]

    def risen(time_s: Array, shapes: Array) -> Array:
        over = np.maximum(time_s - shapes, 0.0)
        return np.broadcast_to(over[..., None], (*over.shape, 3))

    by_time = _fall(courses, profiled_sums(courses, lambda each: each.time_s, carrier, risen, times))
    if by_time < _AS_GOOD * _fall(courses, _sums(courses, shape[None])):
        return ""
    return (
        "a force that rises from one time on, the same at every feed, explains as much as flutes that fill; "
        "drill at feeds further apart"
    )


def _fall(courses: Sequence[Course], of_them: Sums) -> float:
    """Fall of the squared error at the best of the shapes, every axis in units of what is left on it."""
    left = np.sqrt(np.mean([np.mean(each.left_n**2, axis=0) for each in courses], axis=0))
    weight = np.where(left > 0.0, 1.0 / np.where(left > 0.0, left, 1.0), 0.0)
    return float(solve(of_them, np.ones(len(courses)), weight)[2].max())


FLUTES = Kind(
    NAME,
    lambda courses: of_a_drill(courses) and at_several_feeds(courses),
    _capacities,
    _columns,
    _effect,
    _parts,
    rather=rather_in_time,
    refine=_near,
    sums=_sums,
)
"""How a drill's clogging is looked for along a trial."""
