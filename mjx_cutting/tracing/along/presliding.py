"""Friction of the drive that builds up as a trial sets out: hysteresis, where the records show it.

A drive at rest first strains its contacts; only after the presliding distance d is the friction whole, and
where it turns back the contacts are strained the other way:

    drag = F_c z + F_v v,   z -> +-1 + (z -+ 1) exp(-s / d)   over a way s forth or back, from z = 0 at rest,

v the feed, along x. In steady motion that is a bias. It shows by its beginning, which is the same way at
every feed, where what settles in time (a filter, a controller) takes the same time; by the loop where a trial
turns back; and where the zero of the sensor is one for all trials, by its rise with the feed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect, effect_class
from mjx_cutting.tracing.along.kind import Kind, listed
from mjx_cutting.tracing.along.shapes import solve, sums
from mjx_cutting.tracing.records.course import Course, at_several_feeds

_FEWEST_SAMPLES = 4.0
_LONGEST = 0.4
_DISTANCES = 48
_CLOSER = 13
_AS_GOOD = 0.9
_NEXT_TO_NONE_N_S_M = 1e-3
Array = NDArray[np.floating]
Columns = Callable[[Course, Array], Array]


def strain(course: Course, presliding_m: float) -> Array:
    """[T] strain z of the contacts, -1 to 1, in a trial that sets out from rest."""
    found, last = np.zeros(len(course.way_m)), 0.0
    for leg, forth in course.legs:
        gone = forth * (course.way_m[leg] - course.way_m[leg.start])
        found[leg] = forth + (last - forth) * np.exp(-np.maximum.accumulate(gone) / presliding_m)
        last = float(found[leg][-1])
    return found


def _distances(courses: Sequence[Course]) -> Array:
    """[P, 1] presliding distances that the slowest trial resolves and the longest sees the end of."""
    ways = [float(np.ptp(each.way_m)) for each in courses]
    least = _FEWEST_SAMPLES * min(way / len(each.time_s) for way, each in zip(ways, courses, strict=True))
    known = effect_class("hysteresis").parameters["presliding_m"]
    low, high = max(least, known.low), min(_LONGEST * max(ways), known.high)
    return np.geomspace(low, high, _DISTANCES)[:, None] if low < high else np.zeros((0, 1))


def _near(shapes: Array, here: Array, zoom: float) -> Array:
    step = np.log(shapes[1, 0] / shapes[0, 0]) if len(shapes) > 1 else 0.1
    return here[0] * np.exp(step / zoom * np.linspace(-1.0, 1.0, _CLOSER))[:, None]


def _drag(course: Course, shape: Array) -> Array:
    """[T, 3, 2] of Coulomb friction at 1 N, of viscous at 1 N s/m."""
    columns = np.zeros((len(course.time_s), 3, 2))
    columns[:, 0, 0] = -strain(course, float(shape[0]))
    for leg, forth in course.legs:
        way_m, taken_s = (float(np.ptp(each[leg])) for each in (course.position_m, course.time_s))
        columns[leg, 0, 1] = -forth * way_m / max(taken_s, 1e-9)
    return columns


def _effect(shape: Array, c: Array) -> AbstractEffect:
    viscous = float(c[1]) if c[1] > _NEXT_TO_NONE_N_S_M else 0.0
    return effect_class("hysteresis")(
        coulomb_n=float(c[0]), presliding_m=float(shape[0]), stiction=1.0, viscous_n_s_m=viscous
    )


def _parts(effect: AbstractEffect) -> tuple[Array, Array]:
    return listed(effect, "presliding_m"), listed(effect, "coulomb_n", "viscous_n_s_m")


def _in_time(course: Course, shape: Array) -> Array:
    columns = _drag(course, np.ones(1))
    columns[:, 0, 0] = np.expm1(-np.maximum(course.time_s - course.delay_s, 0.0) / shape[0])
    return columns


def rather_in_time(
    courses: Sequence[Course], effect: AbstractEffect, seen: Callable[[Columns], Columns] = lambda each: each
) -> str:
    """Why friction is refused that is found where what takes the same time at every feed does as well; ""
    where that does not. `seen` makes of the columns of a drag what the courses show of it."""
    longest = min(float(each.time_s[-1]) for each in courses)
    shortest = _FEWEST_SAMPLES / min(each.rate_hz for each in courses)
    times = np.geomspace(shortest, _LONGEST * longest, _DISTANCES)[:, None]
    by_time = _fall(courses, seen(_in_time), times)
    by_way = _fall(courses, seen(_drag), np.array([[float(effect.values()["presliding_m"])]]))
    if by_time < _AS_GOOD * by_way:
        return ""
    return (
        "what settles at the beginning of the trials takes the same time at every feed as well as the same "
        "way: a filter or a controller does that too; cut at feeds further apart"
    )


def _fall(courses: Sequence[Course], columns: Columns, shapes: Array) -> float:
    """Fall of the squared error along the feed at the best of the shapes, N^2."""
    _, _, fall = solve(sums(columns, courses, shapes), np.ones(len(courses)), np.array([1.0, 0.0, 0.0]))
    return float(fall.max())


HYSTERESIS = Kind(
    "hysteresis",
    at_several_feeds,
    _distances,
    _drag,
    _effect,
    _parts,
    rather=rather_in_time,
    refine=_near,
    untold=("stiction", "viscous_n_s_m"),
)
"""How hysteresis is looked for along a trial."""
