"""Effects that change along a trial: layers of the sheet, mains; and all kinds together.

What such an effect adds to the force of the best steady model is, for given shapes p (a wavelength, a place,
a frequency), linear in a few coefficients c:

    measured - predicted = X_p(t) c + noise,      X_p for instance  chip wave x cos(2 pi s / wavelength)

Whatever a change of the whole trial's chip, edge or zero could imitate is first taken out of X_p. The fits
are in `shapes`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect, effect_class
from mjx_cutting.cutting.effects.layered_material import BORDER_M, TORQUE_POWER
from mjx_cutting.tracing.along.damped import DAMPED
from mjx_cutting.tracing.along.end_layer import at_the_end
from mjx_cutting.tracing.along.flutes import FLUTES
from mjx_cutting.tracing.along.kind import Kind, as_values, listed
from mjx_cutting.tracing.along.periodic import PERIODIC
from mjx_cutting.tracing.along.presliding import HYSTERESIS
from mjx_cutting.tracing.along.shapes import Sums, harmonic_sums, profiled_sums, stacked_sums
from mjx_cutting.tracing.along.stair import STAIR
from mjx_cutting.tracing.records.course import Course, at_several_feeds

Array = NDArray[np.floating]


def _position(course: Course) -> Array:
    return course.position_m


def _layers(courses: Sequence[Course]) -> Array:
    low = min(float(each.position_m.min()) for each in courses)
    high = max(float(each.position_m.max()) for each in courses)
    border = np.linspace(low, high, 41)
    return np.asarray(
        [
            (a, b - a, BORDER_M)
            for i, a in enumerate(border[:-1])
            for b in border[i + 1 :]
            if b - a < 0.9 * (high - low)
        ]
    )


def _inside(power: Sequence[float], place_m: Array, shapes: Array) -> Array:
    """[P, T, 3] share of the force along each axis that is inside layers [P, 3] at places [T]."""
    start, length, border = np.split(shapes, 3, axis=1)
    entered, left = (
        np.clip(0.5 + (place_m - border_at) / border, 0.0, 1.0) for border_at in (start, start + length)
    )
    by_power = {each: entered**each - left**each for each in set(power)}
    if len(by_power) == 1:
        return np.broadcast_to(by_power[power[0]][..., None], (*entered.shape, 3))
    return np.stack([by_power[each] for each in power], axis=-1)


def _layers_near(shapes: Array, here: Array, zoom: float) -> Array:
    step = float(np.min(np.diff(np.unique(shapes[:, 0])))) / zoom if len(shapes) > 1 else 1e-3
    shift = step * np.linspace(-1.0, 1.0, 13)
    ends = here[0] + here[1]
    near = [(here[0] + a, ends + b - here[0] - a, here[2]) for a in shift for b in shift]
    return np.asarray([each for each in near if each[1] > 0.2 * step])


def _layers_of(edge_share: float, by_direction: bool = False, blended: bool = False) -> Kind:
    """Layers in which the edge constants change by a share of what those of the chip do; if `by_direction`,
    by as much, and the constants of each direction by a share of their own; if `blended`, with borders that a
    drill's torque crosses with its thrust."""

    def power(course: Course) -> Sequence[float]:
        return (1.0, 1.0, 1.0) if blended else course.border_power

    def carrier(course: Course) -> Array:
        return course.force_by_direction() if by_direction else course.force(edge_share)[..., None]

    def profile(courses: Sequence[Course]) -> Callable[[Array, Array], Array]:
        return partial(_inside, power(courses[0]))

    def columns(course: Course, shape: Array) -> Array:
        return _inside(power(course), course.position_m, shape[None])[0, ..., None] * carrier(course)

    def effect(shape: Array, c: Array) -> AbstractEffect:
        start, length, border = map(float, shape)
        change = float(c[np.argmax(np.abs(c))])
        # a direction that nothing is measured of changes as the others do
        share = np.where(c == 0.0, 1.0, c / change) if by_direction and change else np.ones(3)
        torque_power = 1.0 if blended else TORQUE_POWER
        return effect_class(LAYERED)(change, start, length, border, edge_share, share, torque_power)

    def parts(layer: AbstractEffect) -> tuple[Array, Array]:
        change, share = listed(layer, "change"), as_values(layer)["direction_share"]
        return listed(layer, "start_m", "length_m", "border_m"), change * share if by_direction else change

    return Kind(
        LAYERED,
        at_several_feeds,
        _layers,
        columns,
        effect,
        parts,
        several=True,
        shared=True,
        rather=at_the_end,
        refine=_layers_near,
        sums=lambda courses, shapes: profiled_sums(courses, _position, carrier, profile(courses), shapes),
        stack=lambda courses: stacked_sums(courses, _position, carrier, profile(courses)),
    )


def _mains(courses: Sequence[Course]) -> Array:
    """[P, 1] the mains and harmonics of it (a rectifier draws odd ones), as far as they stray, as finely as
    the longest trial can tell."""
    top, longest = courses[0].band_hz[1], max(float(each.time_s[-1]) for each in courses)
    stray = np.arange(-_MAINS_STRAY_HZ, _MAINS_STRAY_HZ + 1e-9, min(0.125 / longest, _MAINS_STRAY_HZ))
    lines = [(f + off) * n for f in (50.0, 60.0) for n in _HARMONICS for off in stray]
    return np.asarray([[line] for line in lines if line < top])


def _mains_columns(course: Course, shape: Array) -> Array:
    turn = 2.0 * np.pi * shape[0] * course.time_s
    columns = np.zeros((len(turn), 3, 6))
    for axis in range(3):
        columns[:, axis, axis], columns[:, axis, 3 + axis] = np.cos(turn), -np.sin(turn)
    return columns


def _mains_sums(courses: Sequence[Course], shapes: Array) -> Sums:
    def each_axis(course: Course) -> Array:
        return np.broadcast_to(np.eye(3), (len(course.time_s), 3, 3))

    return harmonic_sums(courses, lambda course: course.time_s, each_axis, shapes[:, 0])


def _mains_effect(shape: Array, c: Array) -> AbstractEffect:
    return effect_class("mains_pickup")(
        amplitude_n=np.hypot(c[:3], c[3:]), phase_rad=np.arctan2(c[3:], c[:3]), frequency_hz=float(shape[0])
    )


def _parts_of_mains(effect: AbstractEffect) -> tuple[Array, Array]:
    values = as_values(effect)
    amplitude, phase = values["amplitude_n"], values["phase_rad"]
    return listed(effect, "frequency_hz"), np.concatenate(
        [amplitude * np.cos(phase), amplitude * np.sin(phase)]
    )


def _mains_of_the_spindle(courses: Sequence[Course], effect: AbstractEffect) -> str:
    """A line that stays put while the spindle changes its speed is of the mains; one that stands at a
    multiple of the spindle in most trials may be the spindle's, unless the others show it as large."""
    line_hz = float(effect.values()["frequency_hz"])
    apart = []
    for course in courses:
        if len(course.angle_rad) < 2:
            return ""
        turns = float(np.ptp(course.angle_rad)) / (2.0 * np.pi)
        order = line_hz * float(np.ptp(course.time_s)) / turns
        apart.append(abs(order - np.round(order)) * turns > _RESOLVED)
    if 2 * sum(apart) > len(apart) or _as_large_in(compress(courses, apart), effect):
        return ""
    return (
        f"{line_hz:.2f} Hz is a multiple of the spindle's frequency in {len(apart) - sum(apart)} of "
        f"{len(apart)} trials: what stands there may be the spindle's as well; cut at another speed"
    )


def _as_large_in(courses: Iterable[Course], effect: AbstractEffect) -> bool:
    """Whether a few trials or more, or both of two, show a line of the mains as large as all together do."""
    line_hz, whole = (np.asarray(effect.values()[name]) for name in ("frequency_hz", "amplitude_n"))
    shares = []
    for course in courses:
        wave = np.exp(-2j * np.pi * line_hz * course.time_s)
        own = 2.0 / len(wave) * np.abs(wave @ (course.left_n - course.left_n.mean(axis=0)))
        shares.append(float(own @ whole / max(float(whole @ whole), 1e-300)))
    if len(shares) < 2:
        return False
    told = [float(np.median(shares))] if len(shares) > 2 else shares
    return all(abs(each - 1.0) < _AS_LARGE for each in told)


_HARMONICS = (1, 2, 3, 5, 7)
_MAINS_STRAY_HZ = 0.06
_RESOLVED = 1.5
_AS_LARGE = 0.25
BY_PLACE = ("material_periodicity", "layered_material", "hysteresis")
"""Slow effects bound to the way, of the sheet or of the drive."""
LAYERED = "layered_material"
_LAYERS = _layers_of(1.0)
KINDS: tuple[Kind, ...] = (
    PERIODIC,
    _LAYERS,
    Kind(
        "mains_pickup",
        lambda courses: courses[0].band_hz[1] > 50.0,
        _mains,
        _mains_columns,
        _mains_effect,
        _parts_of_mains,
        own_phase=True,
        several=True,
        rather=_mains_of_the_spindle,
        sums=_mains_sums,
    ),
    STAIR,
    HYSTERESIS,
    FLUTES,
    DAMPED,
)
"""Slow effects that tracing looks for by itself, beside the ends of the sheet (`ends`)."""


def kind_of(effect: AbstractEffect) -> Kind | None:
    """How an effect along the trial is looked for, the ends of the sheet left out; None where it is not."""
    found = next((kind for kind in KINDS if kind.effect is type(effect)), None)
    if found is not _LAYERS:
        return found
    values = as_values(effect)
    return _layers_of(
        float(values["edge_share"]),
        bool(np.any(values["direction_share"] != 1.0)),
        bool(values["torque_power"] != TORQUE_POWER),
    )


def of_the_chip(kinds: Sequence[Kind], blended: bool = False) -> tuple[Kind, ...]:
    """The kinds, layers among them as such in which the edge's force is that of the sheet."""
    return _with_layers(kinds, _layers_of(0.0, blended=blended))


def of_each_direction(kinds: Sequence[Kind], blended: bool = False) -> tuple[Kind, ...]:
    """The kinds, layers among them as such in which the constants of each direction change by their own."""
    return _with_layers(kinds, _layers_of(1.0, by_direction=True, blended=blended))


def that_blend(kinds: Sequence[Kind]) -> tuple[Kind, ...]:
    """The kinds, layers among them with borders that a drill's torque crosses with its thrust."""
    return _with_layers(kinds, _layers_of(1.0, blended=True))


def _with_layers(kinds: Sequence[Kind], layers: Kind) -> tuple[Kind, ...]:
    return tuple(layers if kind is _LAYERS else kind for kind in kinds)
