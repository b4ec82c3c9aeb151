"""The stair of a commanded feed: held over each period of the policy, each tooth cuts what was fed since the
one before it.

A measured feed that is a stair itself shows its period and when each began, which need not be when the record
did. Any other is held from multiples of the periods tried.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect, effect_class
from mjx_cutting.tracing.along.kind import Kind, listed
from mjx_cutting.tracing.records.blocks import block_means
from mjx_cutting.tracing.records.course import Course
from mjx_cutting.tracing.records.line_gain import heard

Array = NDArray[np.floating]
_PERIODS_S = (0.01, 0.02, 0.025, 0.04, 0.05, 0.1)
_STEP = 0.05
_FLAT = 0.05
_OVER_NOISE = 25.0
_MOST_STEPS = 1.0 / 3.0
_FEWEST_STEPS = 3


def _periods(courses: Sequence[Course]) -> Array:
    """[P, 1] the period that all measured feeds show, else those worth trying, s."""
    own = [_own_starts(each) for each in courses]
    shown = [float(np.median(np.diff(each[1:]))) for each in own if each is not None]
    if len(shown) == len(own) and np.ptp(shown) * courses[0].rate_hz < 1.5:
        return np.array([[np.median(shown)]])
    return np.array(_PERIODS_S)[:, None]


def is_stair(course: Course) -> bool:
    """Whether the measured feed itself is held over periods."""
    return _own_starts(course) is not None


def _own_starts(course: Course) -> Array | None:
    """[S] times at which a measured feed that is a stair was taken anew, the record's first included; None
    where it is no stair."""
    assert course.feed_share is not None
    change = np.diff(course.feed_share) ** 2
    # of a feed that is held, most changes are noise of its sensor
    steps = change > max(_STEP**2 * float(np.var(course.feed_share)), _OVER_NOISE * float(np.median(change)))
    if not _FEWEST_STEPS < steps.sum() < _MOST_STEPS * len(change):
        return None
    if change[~steps].sum() > _FLAT * change.sum():
        return None
    return np.concatenate([course.time_s[:1], course.time_s[1:][steps]])


def _stair(course: Course, shape: Array) -> Array:
    assert course.feed_share is not None
    period_s, time_s = float(shape[0]), course.time_s
    starts = _own_starts(course)
    if starts is None:
        starts = period_s * np.arange(int(time_s[-1] / period_s + 1e-6) + 1)
        first = np.minimum(np.searchsorted(time_s, starts - 1e-6), len(time_s) - 1)
        held = course.feed_share[first]
    else:
        held = block_means(course.feed_share, np.searchsorted(time_s, starts - 1e-6))
        # it was taken anew between two samples
        starts = starts - np.append(0.0, np.full(len(starts) - 1, 0.5 / course.rate_hz))
    # what came before the record is as its beginning
    earlier_s, over_s = course.pitch_s, course.fed_over_s
    edges = np.concatenate([[-earlier_s], starts, [starts[-1] + period_s]])
    fed = np.concatenate([[-earlier_s * held[0], 0.0], np.cumsum(held * np.diff(edges[1:]))])
    since = np.interp(time_s, edges, fed) - np.interp(time_s - over_s, edges, fed)
    share = heard(since / over_s, course.alias, course.rate_hz)
    return (share[:, None] * course.force(0.0))[..., None]


def _effect(shape: Array, c: Array) -> AbstractEffect:
    return effect_class("command_stair")(share=float(c[0]), period_s=float(shape[0]))


def _parts(effect: AbstractEffect) -> tuple[Array, Array]:
    return listed(effect, "period_s"), listed(effect, "share")


STAIR = Kind(
    "command_stair",
    lambda courses: all(each.feed_share is not None for each in courses),
    _periods,
    _stair,
    _effect,
    _parts,
)
