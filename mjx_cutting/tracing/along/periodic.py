"""A sheet that is harder and softer by turns: at the place of the tool's centre, or where every tooth is.

A tooth in the cut is R sin th ahead of the centre. Over an arc longer than the wavelength that is all the
difference: what one tooth meets hard, another meets soft. The waves of chip and edge are then those of teeth
whose force turns with exp(i k R sin th), one pair a wavelength (`Course.at_teeth`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect, effect_class
from mjx_cutting.tracing.along.at_teeth import SHORTEST_M
from mjx_cutting.tracing.along.kind import Kind, listed
from mjx_cutting.tracing.along.shapes import Sums, harmonic_sums, put_together
from mjx_cutting.tracing.records.course import Course, at_several_feeds

_MOST_SHAPES = 2000
_FEWEST_WAVES, _OF_LONG_ONES = 2.0, 3.0
_LONG_M = 1e-2
_SAME_AT_CENTRE_RAD = 0.5
_APART_RAD = 0.8
_CARRIERS_AT_ONCE = 16
_MOST_SAMPLES = 4e7
_FEWEST_CARRIERS = 8
# columns of one complex wave (C, S) out of those of C and S each by itself
_TURNED = np.array([[1.0, 0.0], [0.0, -1.0], [0.0, 1.0], [1.0, 0.0]])
Array = NDArray[np.floating]


def _shapes(courses: Sequence[Course]) -> Array:
    """[P, 3] wavelengths from half of the path down to 1 mm, as many as the positions tell apart, edge's
    share nil at first, at the tool's centre; then again those that a pattern met by the teeth tells from it.
    Longer ones than a sheet's usually are, 2 to 10 mm, go into the path three times: two swells of any force
    along it are a wave and a half.
    """
    path = max(float(np.ptp(each.position_m)) for each in courses)
    span = max(float(e.position_m.max()) for e in courses) - min(float(e.position_m.min()) for e in courses)
    samples_per_m = min(len(each.time_s) / max(float(np.ptp(each.position_m)), 1e-9) for each in courses)
    waves = np.arange(_FEWEST_WAVES / path, min(1e3, 0.4 * samples_per_m), 0.25 / span)
    waves = waves[(waves > 1.0 / _LONG_M) | (waves > _OF_LONG_ONES / path)]
    centre = 1.0 / waves[:_MOST_SHAPES, None] * [1.0, 0.0, 0.0]
    radians = 2.0 * np.pi / centre[:, 0] * _reach(courses)
    carriers = max(_MOST_SAMPLES / sum(len(each.time_s) for each in courses), _FEWEST_CARRIERS)
    told = (radians > _SAME_AT_CENTRE_RAD) & (radians < _APART_RAD * carriers) & (centre[:, 0] > SHORTEST_M)
    return np.concatenate([centre, centre[told] + [0.0, 0.0, 1.0]])


def _reach(courses: Sequence[Course]) -> float:
    """How far apart along the path teeth in the cut are at most, m; nil where that is not known."""
    ahead = courses[0].ahead_m
    return 0.0 if courses[0].at_teeth is None else ahead[1] - ahead[0]


def _place(course: Course, at_teeth: bool) -> Array:
    """[T] place of the tool's centre, or of the middle of the arc."""
    return course.position_m + at_teeth * 0.5 * sum(course.ahead_m)


def _columns(course: Course, shape: Array) -> Array:
    wavelength, edge_share, at_teeth = float(shape[0]), float(shape[1]), bool(shape[2])
    turn = np.exp(2j * np.pi * _place(course, at_teeth) / wavelength)[:, None]
    if at_teeth:
        turn = turn * course.force_at_teeth([2.0 * np.pi / wavelength], edge_share)[0]
    else:
        turn = turn * course.force(edge_share)
    return np.stack([turn.real, -turn.imag], axis=-1)


def _sums(courses: Sequence[Course], shapes: Array) -> Sums:
    parts, places = [], []
    for share, at_teeth in np.unique(shapes[:, 1:], axis=0):
        here = np.flatnonzero((shapes[:, 1] == share) & (shapes[:, 2] == at_teeth))
        if at_teeth:
            each = _sums_at_teeth(courses, shapes[here, 0], float(share))
        else:
            each = [(np.arange(len(here)), _sums_at_centre(courses, shapes[here, 0], float(share)))]
        places += [here[of_it] for of_it, _ in each]
        parts += [found for _, found in each]
    return put_together(parts, places)


def _sums_at_centre(courses: Sequence[Course], wavelength: Array, share: float) -> Sums:
    def carrier(course: Course) -> Array:
        return course.force(share)[..., None]

    return harmonic_sums(courses, lambda course: _place(course, False), carrier, 1.0 / wavelength)


def _sums_at_teeth(
    courses: Sequence[Course], wavelength: Array, share: float
) -> list[tuple[NDArray[np.int64], Sums]]:
    """The places in `wavelength` [P] of those whose carriers, counted from the middle of the arc, are nearly
    one (within .2 rad at its ends: a shape loses 4 % at most), with their sums."""
    radians = 2.0 * np.pi / wavelength * _reach(courses)
    group = np.floor((radians - radians.min()) / _APART_RAD).astype(int)
    groups = [np.flatnonzero(group == each) for each in np.unique(group)]
    wave = [np.pi * (1.0 / wavelength[each].min() + 1.0 / wavelength[each].max()) for each in groups]
    found = []
    for first in range(0, len(groups), _CARRIERS_AT_ONCE):
        stretch = slice(first, first + _CARRIERS_AT_ONCE)
        carriers = [course.force_at_teeth(wave[stretch], share) for course in courses]
        for number, of_it in enumerate(groups[stretch]):
            own = {id(course): each[number] for course, each in zip(courses, carriers, strict=True)}

            def carrier(course: Course, own: dict[int, NDArray] = own) -> Array:
                return np.stack([own[id(course)].real, own[id(course)].imag], axis=-1)

            each = harmonic_sums(
                courses, lambda course: _place(course, True), carrier, 1.0 / wavelength[of_it]
            )
            found.append((of_it, Sums(_TURNED.T @ each.square @ _TURNED, each.product @ _TURNED)))
    return found


def _effect(shape: Array, c: Array) -> AbstractEffect:
    return effect_class("material_periodicity")(
        amplitude=float(np.hypot(*c)),
        wavelength_m=float(shape[0]),
        phase_rad=float(np.arctan2(c[1], c[0])),
        edge_share=float(shape[1]),
        tooth_place=float(shape[2]),
    )


def _parts(effect: AbstractEffect) -> tuple[Array, Array]:
    amplitude, phase = listed(effect, "amplitude", "phase_rad")
    shape = listed(effect, "wavelength_m", "edge_share", "tooth_place")
    return shape, amplitude * np.array([np.cos(phase), np.sin(phase)])


def _near(shapes: Array, here: Array, zoom: float) -> Array:
    waves = 1.0 / shapes[:, 0]
    step = abs(waves[1] - waves[0]) / zoom if len(waves) > 1 else 1.0
    near = 1.0 / np.maximum(1.0 / here[0] + step * np.linspace(-1.0, 1.0, 41), 1e-3)
    return np.array([(wave, share, here[2]) for share in (0.0, 1.0) for wave in near])


PERIODIC = Kind(
    "material_periodicity",
    at_several_feeds,
    _shapes,
    _columns,
    _effect,
    _parts,
    several=True,
    refine=_near,
    sums=_sums,
)
"""A periodic sheet, as `slow_kinds` looks for it."""
