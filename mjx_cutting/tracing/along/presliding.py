"""Friction of a drive that builds up as a trial sets out, or turns back: hysteresis, where records show it.

A drive at rest first strains its contacts; only after the presliding distance d is the friction whole, and
where it turns back the contacts are strained the other way:

    drag = F_c z + F_v v,   z -> +-1 + (z -+ 1) exp(-s / d)   over a way s forth or back, from z = 0 at rest,

v the feed, along x; or the motion across the path, along y, where that was measured. In steady motion that is
a bias. It shows by its beginning, which is the same way at every feed, where what settles in time (a filter,
a controller) takes the same time; by the loop where a trial turns back; and where the zero of the sensor is
one for all trials, by its rise with the feed. How far the contacts give way less where they are strained the
other way (`beta`) only a loop tells. Across the path a drive may have moved before the record begins: how its
contacts are strained then is fitted in each trial.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjx_cutting.cutting import AbstractEffect, effect_class
from mjx_cutting.tracing.along.kind import Kind, listed
from mjx_cutting.tracing.along.shapes import solve, sums
from mjx_cutting.tracing.records.blocks import block_edges, block_means
from mjx_cutting.tracing.records.course import Course, at_several_feeds

_STRAIGHT = 1e-6
_BETAS = (1.0, 0.8, 0.65, 0.5)
_BETA_STEP = 0.1
_BEGUN = np.linspace(-1.0, 1.0, 21)
_FEWEST_SAMPLES = 4.0
_LONGEST = 0.4
_DISTANCES = 48
_CLOSER = 13
_AS_GOOD = 0.9
_BLOCKS = 512
_MOST_TURNS = 50
_NEXT_TO_NONE_N_S_M = 1e-3
Array = NDArray[np.floating]
Columns = Callable[[Course, Array], Array]


def strain(
    course: Course, presliding_m: float, across: bool = False, beta: float = 1.0, begun: ArrayLike = 0.0
) -> Array:
    """[..., T] strain z of the contacts, -1 to 1, in a trial that sets out from `begun` [...]: of the drive
    of the feed, or of that `across` the path, which stays as it is where that was not measured."""
    legs = course.legs_beside if across else course.legs
    if legs is None:
        return np.broadcast_to(np.asarray(begun)[..., None], (*np.shape(begun), len(course.time_s)))
    last, first = np.asarray(begun, dtype=float), []
    for forth, whole_m in zip(legs.forth, legs.whole_m, strict=True):
        first.append(forth * last)
        last = forth * strained(forth * last, whole_m / presliding_m, beta)
    before = np.stack(first, axis=-1)[..., legs.leg]
    return legs.forth[legs.leg] * strained(before, legs.gone_m / presliding_m, beta)


def strained(last: Array, gone: Array | float, beta: float) -> Array:
    """[...] strain of contacts after a way forth, in presliding distances, from the `last` (as the effect's
    own `strained` has it)."""
    if beta == 1.0:
        return 1.0 + (last - 1.0) * np.exp(-gone)
    back, stiffer = np.maximum(-last, 0.0), 2.0 * beta - 1.0
    stiffer = stiffer if abs(stiffer) > _STRAIGHT else _STRAIGHT
    to_0 = np.log1p(stiffer * back) / stiffer
    short = -back * np.exp(-stiffer * gone) - np.expm1(-stiffer * gone) / stiffer
    beyond = 1.0 + (np.maximum(last, 0.0) - 1.0) * np.exp(-np.maximum(gone - to_0, 0.0))
    return np.where(gone < to_0, short, beyond)


def _few(course: Course) -> Course:
    """The trial as means of few blocks."""
    assert course.beside_m is not None
    edges = block_edges(len(course.time_s), _BLOCKS)
    left_n = np.column_stack([block_means(axis, edges) for axis in course.left_n.T])
    time_s, beside_m = (block_means(each, edges) for each in (course.time_s, course.beside_m))
    return replace(course, time_s=time_s, beside_m=beside_m, left_n=left_n)


def _begun(course: Course, presliding_m: float, beta: float) -> float:
    """Strain of the contacts of a drive across the path as the record begins, where it turns back and so
    tells it; else nil."""
    if course.legs_beside is None or len(course.legs_beside.forth) < 2 or not _goes_across(course):
        return 0.0
    few = _few(course)
    drag = -strain(few, presliding_m, True, beta, _BEGUN)
    drag -= drag.mean(axis=1, keepdims=True)
    left_n = few.left_n[:, 1] - few.left_n[:, 1].mean()
    explained = np.maximum(drag @ left_n, 0.0) ** 2 / np.maximum(np.sum(drag**2, axis=1), 1e-300)
    return float(_BEGUN[np.argmax(explained)]) if explained.any() else 0.0


def _goes_across(course: Course) -> bool:
    """Whether a drive moves the tool across the path as the record has it, and does not only vibrate."""
    return course.legs_beside is not None and len(course.legs_beside.forth) <= _MOST_TURNS


def _shows(courses: Sequence[Course]) -> bool:
    """Whether a drive's friction shows in these trials."""
    return at_several_feeds(courses) or any(map(_goes_across, courses))


def _shapes(courses: Sequence[Course]) -> Array:
    """[P, 3] presliding distances that the slowest trial resolves and the longest sees the end of; of the
    drive of the feed, 0.0, and of that across the path, 1.0, where its way was measured; and loops, where
    some trial turns back."""
    known = effect_class("hysteresis").parameters["presliding_m"]
    found: list[tuple[float, float, float]] = []
    along = [each.legs for each in courses] if at_several_feeds(courses) else []
    across = [each.legs_beside for each in courses if each.legs_beside is not None and _goes_across(each)]
    for drive, ways in ((0.0, along), (1.0, across)):
        if not ways:
            continue
        least = _FEWEST_SAMPLES * min(legs.span_m / len(legs.leg) for legs in ways)
        most = _LONGEST * max(legs.span_m for legs in ways)
        low, high = max(least, known.low), min(most, known.high)
        turns = any(len(legs.forth) > 1 for legs in ways)
        for beta in _BETAS if turns else _BETAS[:1]:
            distances = np.geomspace(low, high, _DISTANCES) if low < high else ()
            found += [(float(each), drive, beta) for each in distances]
    return np.reshape(found, (-1, 3))


def _near(shapes: Array, here: Array, zoom: float) -> Array:
    step = np.log(shapes[1, 0] / shapes[0, 0]) if len(shapes) > 1 else 0.1
    closer = here[0] * np.exp(step / zoom * np.linspace(-1.0, 1.0, _CLOSER))
    betas = here[2:]
    if np.ptp(shapes[:, 2]) > 0.0:
        betas = np.clip(here[2] + _BETA_STEP / zoom * np.array([-1.0, 0.0, 1.0]), _BETAS[-1], _BETAS[0])
    return np.array([(each, here[1], beta) for beta in np.unique(betas) for each in closer])


def _drag(course: Course, shape: Array) -> Array:
    """[T, 3, 2] of Coulomb friction at 1 N, of viscous at 1 N s/m."""
    presliding_m, drive, beta = map(float, shape)
    columns, across = np.zeros((len(course.time_s), 3, 2)), bool(drive)
    begun = _begun(course, presliding_m, beta) if across else 0.0
    columns[:, int(across), 0] = -strain(course, presliding_m, across, beta, begun)
    columns[:, int(across), 1] = -_mean_speed_m_s(course, across)
    return columns


def _mean_speed_m_s(course: Course, across: bool) -> Array:
    """[T] speed of a drive, of each leg the mean, m/s."""
    legs = course.legs_beside if across else course.legs
    if legs is None:
        return np.zeros(len(course.time_s))
    first = np.searchsorted(legs.leg, np.arange(len(legs.forth)))
    last = np.append(first[1:], len(legs.leg)) - 1
    taken_s = course.time_s[last] - course.time_s[first]
    return (legs.forth * legs.whole_m / np.maximum(taken_s, 1e-9))[legs.leg]


def _effect(shape: Array, c: Array) -> AbstractEffect:
    viscous = float(c[1]) if c[1] > _NEXT_TO_NONE_N_S_M else 0.0
    presliding_m, across, beta = map(float, shape)
    return effect_class("hysteresis")(
        coulomb_n=float(c[0]),
        presliding_m=presliding_m,
        stiction=1.0,
        viscous_n_s_m=viscous,
        across=across,
        beta=beta,
    )


def _parts(effect: AbstractEffect) -> tuple[Array, Array]:
    return listed(effect, "presliding_m", "across", "beta"), listed(effect, "coulomb_n", "viscous_n_s_m")


def _in_time(course: Course, shape: Array) -> Array:
    columns = _drag(course, np.array([1.0, *shape[1:]]))
    columns[:, int(shape[1]), 0] = np.expm1(-np.maximum(course.time_s - course.delay_s, 0.0) / shape[0])
    return columns


def _of_a_spring(course: Course, shape: Array) -> Array:
    """[T, 3, 2] of a spring across the path at 1 N/m, of a damper at 1 N s/m."""
    columns = np.zeros((len(course.time_s), 3, 2))
    if course.beside_m is not None:
        columns[:, 1] = -np.column_stack([course.beside_m, np.gradient(course.beside_m, course.time_s)])
    return columns


def rather_otherwise(
    courses: Sequence[Course], effect: AbstractEffect, seen: Callable[[Columns], Columns] = lambda each: each
) -> str:
    """Why friction is refused that is found where what takes the same time at every feed does as well, or a
    spring across the path; "" where they do not. `seen` makes of a drag's columns what the courses show."""
    longest = min(float(each.time_s[-1]) for each in courses)
    shortest = _FEWEST_SAMPLES / min(each.rate_hz for each in courses)
    shape = listed(effect, "presliding_m", "across", "beta")
    times = np.tile(shape, (_DISTANCES, 1))
    times[:, 0] = np.geomspace(shortest, _LONGEST * longest, _DISTANCES)
    by_time = _fall(courses, seen(_in_time), times)
    by_way = _fall(courses, seen(_drag), shape[None])
    if shape[1] and _fall(courses, seen(_of_a_spring), shape[None]) > _AS_GOOD * by_way:
        return (
            "a force that goes with the place across the path, or with its rate, does as well: no loop tells "
            "friction from a spring; move across the path further"
        )
    if by_time < _AS_GOOD * by_way:
        return ""
    return (
        "what settles at the beginning of the trials takes the same time at every feed as well as the same "
        "way: a filter or a controller does that too; cut at feeds further apart"
    )


def _fall(courses: Sequence[Course], columns: Columns, shapes: Array) -> float:
    """Fall of the squared error along the drive at the best of the shapes of one, N^2."""
    _, _, fall = solve(sums(columns, courses, shapes), np.ones(len(courses)), np.eye(3)[int(shapes[0, 1])])
    return float(fall.max())


HYSTERESIS = Kind(
    "hysteresis",
    _shows,
    _shapes,
    _drag,
    _effect,
    _parts,
    rather=rather_otherwise,
    refine=_near,
    untold=("stiction", "viscous_n_s_m", "beta"),
)
"""How hysteresis is looked for along a trial."""
