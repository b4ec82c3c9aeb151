"""Feed and spindle speed measured along a record: each tooth cuts what was fed since the one before it.

That is the base model's own chip and no effect, so the prediction follows it. Where the feed may have been
held over periods in between, or what was measured is a stair itself, it is left to that effect (`stair`); a
feed that changes little within any period shows none.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.along.stair import STAIR, is_stair
from mjx_cutting.tracing.records.course import Course
from mjx_cutting.tracing.records.even_time import later
from mjx_cutting.trials.dataset import Dataset

_SURE = 2.0
_UNLIKE = 5e-3
Array = NDArray[np.floating]


def may_be_followed(dataset: Dataset) -> bool:
    """Whether any cut trial has a measured feed, or a spindle speed that is seen to change."""
    cuts = [trial for trial in dataset.trials if trial.kind == "cut"]
    return any(each.feed_speed_measured_m_s is not None or later(each) is not None for each in cuts)


def as_fed(courses: Sequence[Course], weight: Array) -> tuple[Array, ...] | None:
    """[T, 3] by trial what the force is more, N, as more was fed than the steady prediction has it.

    None where in none of the `courses` a feed was measured or a speed is seen to change, where the force does
    not go with them, and where it may go with a feed held over periods. `weight` [3]: 1 / standard deviation
    of each axis.
    """
    if any(each.feed_share is not None and is_stair(each) for each in courses):
        courses = [replace(each, feed_share=None) for each in courses]
    fed = [index for index, each in enumerate(courses) if each.feed_share is not None]
    if not fed and all(each.later is None for each in courses):
        return None
    added = _own(courses, [followed(each) for each in courses])
    goes = _falls(courses, added, weight, 1.0).sum() > 0.0
    if not goes or (fed and _held([courses[each] for each in fed], [added[each] for each in fed], weight)):
        return None
    return tuple(added)


def followed(course: Course) -> Array:
    """[T, 3] force of what was fed since the last tooth beyond what is fed on the mean, N."""
    time_s, seen_s = course.time_s, course.time_s - course.delay_s
    pitch_s = np.full(len(time_s), course.fed_over_s)
    if course.later is not None:
        pitch_s = pitch_s * (1.0 + np.interp(seen_s, time_s, course.later))
    share = np.zeros(len(time_s)) if course.feed_share is None else course.feed_share
    step = np.diff(time_s, prepend=time_s[0])
    fed = np.cumsum(0.5 * (share + np.concatenate([share[:1], share[:-1]])) * step)
    # what came before the record is as its beginning
    earlier_s = course.delay_s + float(np.max(pitch_s))
    fed, edges = np.append(-earlier_s * share[0], fed), np.append(time_s[0] - earlier_s, time_s)
    since = np.interp(seen_s, edges, fed) - np.interp(seen_s - pitch_s, edges, fed)
    return ((since + pitch_s) / course.fed_over_s - 1.0)[:, None] * course.force(0.0)


def as_chips_are_cut(courses: Sequence[Course], weight: Array) -> tuple[Course, ...]:
    """The courses, their chips those of the feed of the instant where the force surely goes with that rather
    than with what was fed since the last tooth: so does what others calculate."""
    of_instant = tuple(replace(each, by_tooth=False) for each in courses)
    ways = [[each for each in way if each.feed_share is not None] for way in (courses, of_instant)]
    if not ways[0]:
        return tuple(courses)
    by_tooth, of_it = (_falls(way, _most_like(way, weight), weight) for way in ways)
    return of_instant if _surely(of_it - by_tooth) else tuple(courses)


def _most_like(courses: Sequence[Course], weight: Array) -> list[Array]:
    """The force that goes with the feed as it was measured or held over periods, whichever explains most."""
    held = [_own(courses, forces) for forces in _held_forces(courses)]
    ways = [_own(courses, [followed(each) for each in courses]), *held]
    return max(ways, key=lambda way: float(np.sum(_falls(courses, way, weight))))


def _held_forces(courses: Sequence[Course]) -> Iterator[list[Array]]:
    """The forces [T, 3] of the feed held over each of the periods worth trying."""
    for shape in STAIR.grid(courses):
        yield [STAIR.columns(each, shape)[..., 0] for each in courses]


def _held(courses: Sequence[Course], added: Sequence[Array], weight: Array) -> bool:
    """Whether it may be the feed held over periods that the force goes with: it is unlike the feed as it was
    measured, `added`, and not sure to explain less of the trials; a share of either, the best over all."""
    ways = [_own(courses, forces) for forces in _held_forces(courses)]
    falls, held = max(
        ((_falls(courses, way, weight), way) for way in ways), key=lambda way: float(way[0].sum())
    )
    apart = [one - other for one, other in zip(held, added, strict=True)]
    surely = _surely(_falls(courses, added, weight) - falls)
    return not surely and _energy(apart, weight) > _UNLIKE * _energy(added, weight)


def _surely(more: Array) -> bool:
    """Whether what is more in each trial [R] is so over all, beside how it scatters."""
    return bool(np.sum(more) > _SURE * np.sqrt(len(more)) * np.std(more))


def _energy(forces: Sequence[Array], weight: Array) -> float:
    return float(sum(np.sum(force**2 @ weight**2) for force in forces))


def _own(courses: Sequence[Course], forces: Sequence[Array]) -> list[Array]:
    """Forces [T, 3] without what a change of the whole trial could imitate."""
    return [each.own(force[..., None])[..., 0] for each, force in zip(courses, forces, strict=True)]


def _falls(
    courses: Sequence[Course], added: Sequence[Array], weight: Array, share: float | None = None
) -> Array:
    """[R] fall of each trial's weighted squared error by a share of the forces `added` [T, 3]; default the
    best share over all trials."""
    product, square = (
        np.array([np.sum((one * other) @ weight**2) for one, other in pairs])
        for pairs in (
            [(each.left_n, force) for each, force in zip(courses, added, strict=True)],
            [(force, force) for force in added],
        )
    )
    if share is None:
        share = float(product.sum() / max(square.sum(), 1e-300))
    return np.asarray(2.0 * share * product - share**2 * square)
