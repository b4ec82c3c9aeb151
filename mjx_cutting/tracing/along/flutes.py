"""Clogging of a drill: the flutes fill with the chip of the hole, and pressing more into them takes force.

What has been cut since the hole began is the feed per tooth times its depth. Beyond what a flute holds, force
and torque rise in proportion: at a large feed from a small depth on, at a small one from a large depth. That
tells it from what begins at one depth at every feed, and from what takes the same time. Of three feeds or
more it is told how the fill goes with the thickness of the chip: thin ones lie more loosely.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect, effect_class
from mjx_cutting.cutting.effects.clogging import REFERENCE_CHIP_M
from mjx_cutting.tracing.along.kind import Kind, listed
from mjx_cutting.tracing.along.shapes import Sums, profiled_sums, put_together
from mjx_cutting.tracing.records.course import Course, at_several_feeds

NAME = "clogging"
_CAPACITIES = 48
_LEAST, _MOST = 0.05, 0.95
_CLOSER = 13
_CLEARLY_MORE = 1.25
_POWERS = (1.0, 0.75, 0.5, 0.25, 1.25)
_FEEDS, _APART = 3, 1.05
Array = NDArray[np.floating]


def of_a_drill(courses: Sequence[Course]) -> bool:
    """Whether the trials are holes, of which the torque crosses a border one lip after the other."""
    return any(np.ptp(each.border_power) > 0.0 for each in courses)


def cut_since(course: Course, thickness_power: float = 1.0) -> Array:
    """[T] area of chip of .1 mm that fills as much as what a tooth has cut since the hole began, m^2."""
    chip_m = _feed_m_s(course) * course.pitch_s
    looser = (max(chip_m, 1e-9) / REFERENCE_CHIP_M) ** (thickness_power - 1.0)
    return looser * chip_m * np.maximum(course.position_m, 0.0)


def _feed_m_s(course: Course) -> float:
    return float(np.ptp(course.position_m)) / max(float(np.ptp(course.time_s)), 1e-9)


def _powers(courses: Sequence[Course]) -> tuple[float, ...]:
    """Powers of the chip's thickness that may be told: of two feeds any fits."""
    feeds = np.sort([_feed_m_s(each) for each in courses])
    apart = 1 + int(np.sum(feeds[1:] > _APART * feeds[:-1]))
    return _POWERS if apart >= _FEEDS else _POWERS[:1]


def _grid(courses: Sequence[Course]) -> Array:
    """[P, 3] what a flute holds, m^2, from a small part of what the longest hole at the largest feed fills it
    with up to nearly all; the share of the edge's force that rises with the chip's; the power of the chip's
    thickness."""
    return np.array(
        [
            (each, share, power)
            for power in _powers(courses)
            for share in (1.0, 0.0)
            for each in _capacities(courses, power)
        ]
    ).reshape(-1, 3)


def _capacities(courses: Sequence[Course], power: float) -> Array:
    known = effect_class(NAME).parameters["capacity_m2"]
    most = max(float(cut_since(each, power).max()) for each in courses)
    low, high = max(_LEAST * most, known.low), min(_MOST * most, known.high)
    return np.geomspace(low, high, _CAPACITIES) if low < high else np.zeros(0)


def _near(shapes: Array, here: Array, zoom: float) -> Array:
    step = np.log(shapes[1, 0] / shapes[0, 0]) if len(shapes) > 1 else 0.05
    near = here[0] * np.exp(step / zoom * np.linspace(-1.0, 1.0, _CLOSER))
    powers = np.unique(shapes[:, 2])
    closer = here[2] + (0.0 if len(powers) < 2 else 0.5 * np.diff(powers).min() / zoom) * np.array([-1, 0, 1])
    return np.array(
        [(each, share, power) for power in np.unique(closer) for share in (1.0, 0.0) for each in near]
    )


def _overfill(area_m2: Array, capacity_m2: Array) -> Array:
    """[P, T, 3] by how much more than full a flute of each capacity [P] is, at areas [T]."""
    over = np.maximum(area_m2 / capacity_m2[:, None] - 1.0, 0.0)
    return np.broadcast_to(over[..., None], (*over.shape, 3))


def _columns(course: Course, shape: Array) -> Array:
    over = _overfill(cut_since(course, float(shape[2])), shape[:1])[0]
    return np.asarray((over * course.force(float(shape[1])))[..., None])


def _sums(courses: Sequence[Course], shapes: Array) -> Sums:
    parts, places = [], []
    for share, power in np.unique(shapes[:, 1:], axis=0):
        here = np.flatnonzero((shapes[:, 1] == share) & (shapes[:, 2] == power))

        def area(course: Course, power: float = float(power)) -> Array:
            return cut_since(course, power)

        def carrier(course: Course, share: float = float(share)) -> Array:
            return course.force(share)[..., None]

        parts.append(profiled_sums(courses, area, carrier, _profile, shapes[here]))
        places.append(here)
    return put_together(parts, places)


def _profile(area_m2: Array, shapes: Array) -> Array:
    return _overfill(area_m2, shapes[:, 0])


def _effect(shape: Array, c: Array) -> AbstractEffect:
    return effect_class(NAME)(float(c[0]), *(float(each) for each in shape))


def _parts(effect: AbstractEffect) -> tuple[Array, Array]:
    return listed(effect, "capacity_m2", "edge_share", "thickness_power"), listed(effect, "gain")


def rather_a_rise(courses: Sequence[Course], effect: AbstractEffect) -> str:
    """Why clogging is refused where a force that rises from one depth, or one time, on, the same at every
    feed, leaves about as little; "" where neither does. By how much is left to each hole: how large the force
    is that rises, a steady model fitted to clogged holes does not know."""
    _, share, power = _parts(effect)[0]

    def carrier(course: Course) -> Array:
        return course.force(float(share))[..., None]

    capacities = [(each, share, power) for each in _capacities(courses, float(power))]
    of_chip = _left(courses, _sums(courses, np.array(capacities)))
    ways = {"depth": lambda each: each.position_m, "time": lambda each: each.time_s}
    for name, along in ways.items():
        ends = np.array([(along(each).min(), along(each).max()) for each in courses])
        starts = np.linspace(ends.min(), ends.min() + _MOST * np.ptp(ends), _CAPACITIES)[:, None]
        if _left(courses, profiled_sums(courses, along, carrier, _risen, starts)) < _CLEARLY_MORE * of_chip:
            return (
                f"a force that rises from one {name} on, the same at every feed, leaves hardly more than "
                "flutes that fill; drill at feeds further apart"
            )
    return ""


def _risen(way: Array, starts: Array) -> Array:
    """[P, T, 3] by how far places or times [T] are beyond each start [P, 1]."""
    over = np.maximum(way - starts, 0.0)
    return np.broadcast_to(over[..., None], (*over.shape, 3))


def _left(courses: Sequence[Course], of_them: Sums) -> float:
    """Squared error left at the best of the shapes with a gain of each hole's own, beside what a change of
    the whole hole could imitate; every axis in units of what is left without."""
    measured = np.any([each.left_n.any(axis=0) for each in courses], axis=0)
    axes = np.sum([np.sum(each.own(each.left_n[..., None]) ** 2, axis=(0, 2)) for each in courses], axis=0)
    weight = np.where(measured, 1.0 / np.where(measured, axes, 1.0), 0.0)
    square, product = of_them.square[..., 0, 0] @ weight, of_them.product[..., 0] @ weight
    fall = np.sum(product**2 / np.maximum(square, 1e-300), axis=0)
    return float(axes @ weight - fall.max())


FLUTES = Kind(
    NAME,
    lambda courses: of_a_drill(courses) and at_several_feeds(courses),
    _grid,
    _columns,
    _effect,
    _parts,
    rather=rather_a_rise,
    refine=_near,
    sums=_sums,
    untold=("thickness_power",),
)
"""How a drill's clogging is looked for along a trial."""
