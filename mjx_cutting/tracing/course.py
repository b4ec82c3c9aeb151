"""Effects that change along a trial: material that varies with position, mains, a stepped feed.

The lines of a whole trial do not hold them. Given the best steady model, its prediction splits into a wave of
the chip and one of the edge; what such an effect adds is, for given shapes p (a wavelength, a place, a
frequency), linear in a few coefficients c:

    measured - predicted = X_p(t) c + noise,      X_p for instance  chip wave x cos(2 pi s / wavelength)

Whatever a change of the whole trial's chip, edge or zero could imitate is first taken out of X_p. The fits
are in `shapes`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect, effect_class
from mjx_cutting.trials.dataset import Trial

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Course:
    """One trial as the slow effects see it.

    Fields:
        time_s: [T] from its start.
        position_m: [T] along the path, measured or from the feed.
        feed_share: [T] measured feed over nominal, less one, held at no period; None where not measured.
        chip_n, edge_n: [T, 3] waves of the chip and the edge, N.
        left_n: [T, 3] measured less predicted, N.
        rate_hz, band_hz: sampling rate and the band compared.
        index: place among the cut trials; angle_rad: [T] angle of tooth 0 as fitted.
        apart: whether the steady model was fitted to records without what is looked for.
    """

    time_s: Array
    position_m: Array
    feed_share: Array | None
    chip_n: Array
    edge_n: Array
    left_n: Array
    rate_hz: float
    band_hz: tuple[float, float]
    index: int = 0
    angle_rad: Array = field(default_factory=lambda: np.zeros(0))
    apart: bool = False

    def own(self, columns: Array) -> Array:
        """[T, 3, k] columns without what chip, edge and zero of this trial can imitate, where they did."""
        if self.apart:
            return columns
        flat = columns.reshape(-1, columns.shape[-1])
        return (flat - self.same @ (self.same.T @ flat)).reshape(columns.shape)

    @cached_property
    def same(self) -> Array:
        """[3 T, 5] orthonormal span of a change of the chip's force, of the edge's, of the three zeros."""
        zero = np.zeros((*self.chip_n.shape, 3))
        zero[:, range(3), range(3)] = 1.0
        span = np.concatenate([self.chip_n[..., None], self.edge_n[..., None], zero], axis=-1).reshape(-1, 5)
        left, size, _ = np.linalg.svd(
            span / np.maximum(np.linalg.norm(span, axis=0), 1e-12), full_matrices=False
        )
        return left * (size > 1e-6 * size[0])


def along_path(trial: Trial) -> Array:
    """[T] position along the path, m: the measured axis that moves most, or the feed's integral from zero."""
    if trial.position_m is not None:
        axis = int(np.argmax(np.ptp(trial.position_m, axis=0)))
        place = trial.position_m[:, axis]
        return place if place[-1] >= place[0] else -place
    time = trial.time_s - trial.time_s[0]
    if trial.feed_speed_measured_m_s is not None:
        step = np.diff(time, prepend=time[0])
        return np.cumsum(trial.feed_speed_measured_m_s * step)
    return trial.feed_speed_m_s * time


@dataclass(frozen=True, eq=False)
class Kind:
    """How one slow effect is looked for.

    Fields:
        name: the effect in the library.
        testable: whether these trials can show it.
        grid: shapes [P, d] worth trying on these trials.
        columns: [T, 3, k] what one shape adds for each unit coefficient.
        build: the effect from a shape [d] and coefficients [k].
        own_phase: whether the effect starts each trial at a phase of its own, as a line that nothing ties to
            the trial does; its coefficients are then cosines [k / 2] and sines [k / 2].
        ends: why an effect found is rather the end of the sheet, in words; "" where it is not.
        refine: shapes [P, d] around one [d] of those tried, closer than the first grid by a factor and more.
    """

    name: str
    testable: Callable[[Sequence[Course]], bool]
    grid: Callable[[Sequence[Course]], Array]
    columns: Callable[[Course, Array], Array]
    build: Callable[[Array, Array], AbstractEffect]
    own_phase: bool = False
    ends: Callable[[Sequence[Course], AbstractEffect], str] | None = None
    refine: Callable[[Array, Array, float], Array] | None = None

    @property
    def effect(self) -> type[AbstractEffect]:
        """The effect's class."""
        return effect_class(self.name)


def feeds_differ(feeds_m_s: Sequence[float]) -> bool:
    """Whether a place on the path is reached after different times, so that the two can be told apart."""
    return max(feeds_m_s, default=0.0) > _FEEDS_APART * min(feeds_m_s, default=0.0)


def _at_several_feeds(courses: Sequence[Course]) -> bool:
    spans = [(float(np.ptp(each.position_m)), float(np.ptp(each.time_s))) for each in courses]
    return feeds_differ([way / max(time, 1e-9) for way, time in spans])


def _wavelengths(courses: Sequence[Course]) -> Array:
    """[P, 2] wavelengths from half of the path down to 1 mm, as many as the positions tell apart; the
    edge's share is nil at first."""
    path = max(float(np.ptp(each.position_m)) for each in courses)
    span = max(float(e.position_m.max()) for e in courses) - min(float(e.position_m.min()) for e in courses)
    samples_per_m = min(len(each.time_s) / max(float(np.ptp(each.position_m)), 1e-9) for each in courses)
    waves = np.arange(_FEWEST_WAVES / path, min(1e3, 0.4 * samples_per_m), 0.25 / span)
    return 1.0 / waves[:_MOST_SHAPES, None] * [1.0, 0.0]


def _periodic(course: Course, shape: Array) -> Array:
    turn = 2.0 * np.pi * course.position_m / shape[0]
    force = course.chip_n + shape[1] * course.edge_n
    return np.stack([np.cos(turn)[:, None] * force, -np.sin(turn)[:, None] * force], axis=-1)


def _periodic_effect(shape: Array, c: Array) -> AbstractEffect:
    return effect_class("material_periodicity")(
        amplitude=float(np.hypot(*c)),
        wavelength_m=float(shape[0]),
        phase_rad=float(np.arctan2(c[1], c[0])),
        edge_share=float(shape[1]),
    )


def _waves_near(shapes: Array, here: Array, zoom: float) -> Array:
    waves = 1.0 / shapes[:, 0]
    step = abs(waves[1] - waves[0]) / zoom if len(waves) > 1 else 1.0
    near = 1.0 / np.maximum(1.0 / here[0] + step * np.linspace(-1.0, 1.0, 41), 1e-3)
    return np.array([(wave, share) for share in (0.0, 1.0) for wave in near])


def _layers(courses: Sequence[Course]) -> Array:
    low = min(float(each.position_m.min()) for each in courses)
    high = max(float(each.position_m.max()) for each in courses)
    border = np.linspace(low, high, 41)
    pairs = [
        (a, b - a) for i, a in enumerate(border[:-1]) for b in border[i + 1 :] if b - a < 0.9 * (high - low)
    ]
    return np.asarray(pairs)


def _layer(course: Course, shape: Array) -> Array:
    since = course.position_m - shape[0]
    inside = np.clip(0.5 + np.minimum(since, shape[1] - since) / 1e-4, 0.0, 1.0)
    return (inside[:, None] * (course.chip_n + course.edge_n))[..., None]


def _layers_near(shapes: Array, here: Array, zoom: float) -> Array:
    step = float(np.min(np.diff(np.unique(shapes[:, 0])))) / zoom if len(shapes) > 1 else 1e-3
    shift = step * np.linspace(-1.0, 1.0, 13)
    ends = here[0] + here[1]
    pairs = [(here[0] + a, ends + b - here[0] - a) for a in shift for b in shift]
    return np.asarray([pair for pair in pairs if pair[1] > 0.2 * step])


def _layer_at_the_end(courses: Sequence[Course], effect: AbstractEffect) -> str:
    """A layer of less force from the very end of the paths is a tool that is not yet, or no more, engaged."""
    change, start, length = (float(effect.values()[name]) for name in ("change", "start_m", "length_m"))
    low = min(float(each.position_m.min()) for each in courses)
    high = max(float(each.position_m.max()) for each in courses)
    near = _END_SHARE * (high - low)
    if change < 0.0 and (start < low + near or start + length > high - near) and length < 0.5 * (high - low):
        place = "first" if start < low + near else "last"
        return (
            f"force is missing over the {place} {1e3 * length:.1f} mm of the path: the tool enters or leaves "
            "the sheet there; cut the records down to where it is engaged"
        )
    return ""


def _layer_effect(shape: Array, c: Array) -> AbstractEffect:
    return effect_class("layered_material")(
        change=float(c[0]), start_m=float(shape[0]), length_m=float(shape[1])
    )


def _mains(courses: Sequence[Course]) -> Array:
    """[P, 1] the mains and two harmonics, as far as they stray, as finely as the longest trial can tell."""
    top, longest = courses[0].band_hz[1], max(float(each.time_s[-1]) for each in courses)
    stray = np.arange(-_MAINS_STRAY_HZ, _MAINS_STRAY_HZ + 1e-9, min(0.125 / longest, _MAINS_STRAY_HZ))
    lines = [(f + off) * n for f in (50.0, 60.0) for n in (1, 2, 3) for off in stray]
    return np.asarray([[line] for line in lines if line < top])


def _mains_columns(course: Course, shape: Array) -> Array:
    turn = 2.0 * np.pi * shape[0] * course.time_s
    columns = np.zeros((len(turn), 3, 6))
    for axis in range(3):
        columns[:, axis, axis], columns[:, axis, 3 + axis] = np.cos(turn), -np.sin(turn)
    return columns


def _mains_effect(shape: Array, c: Array) -> AbstractEffect:
    return effect_class("mains_pickup")(
        amplitude_n=np.hypot(c[:3], c[3:]), phase_rad=np.arctan2(c[3:], c[:3]), frequency_hz=float(shape[0])
    )


def _stairs(courses: Sequence[Course]) -> Array:
    return np.asarray([[0.01], [0.02], [0.025], [0.04], [0.05], [0.1]])


def _stair(course: Course, shape: Array) -> Array:
    assert course.feed_share is not None
    period = np.floor(course.time_s / shape[0] + 1e-6)
    first = np.searchsorted(period, period)
    return (course.feed_share[first][:, None] * course.chip_n)[..., None]


def _stair_effect(shape: Array, c: Array) -> AbstractEffect:
    return effect_class("command_stair")(share=float(c[0]), period_s=float(shape[0]))


_MOST_SHAPES = 2000
_FEWEST_WAVES = 2.0
_MAINS_STRAY_HZ = 0.06
_END_SHARE = 0.03
_FEEDS_APART = 1.1
BY_PLACE = ("material_periodicity", "layered_material")
"""Slow effects of the sheet, bound to places on it."""
KINDS: tuple[Kind, ...] = (
    Kind(
        "material_periodicity",
        _at_several_feeds,
        _wavelengths,
        _periodic,
        _periodic_effect,
        refine=_waves_near,
    ),
    Kind(
        "layered_material",
        _at_several_feeds,
        _layers,
        _layer,
        _layer_effect,
        ends=_layer_at_the_end,
        refine=_layers_near,
    ),
    Kind(
        "mains_pickup",
        lambda courses: courses[0].band_hz[1] > 50.0,
        _mains,
        _mains_columns,
        _mains_effect,
        own_phase=True,
    ),
    Kind(
        "command_stair",
        lambda courses: all(each.feed_share is not None for each in courses),
        _stairs,
        _stair,
        _stair_effect,
    ),
)
"""Slow effects that tracing looks for by itself, beside the ends of the sheet (`ends`)."""


def as_values(effect: AbstractEffect) -> dict[str, Any]:
    """Parameter values of an effect as arrays, by name."""
    return {name: np.asarray(value, dtype=float) for name, value in effect.values().items()}
