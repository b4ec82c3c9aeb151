"""Entry and exit of the sheet, looked for like the other effects along a trial.

While the tool finds the sheet, or leaves it, its teeth meet material over a part of their arc only. What is
then missing follows from the geometry: for each trial the lines of the steady cut are evaluated at a few
depths of entry, once, and in between interpolated; the place of either end is searched over a grid. The one
coefficient, the share of the geometry that the trials show, must come out near one.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjx_cutting.cutting import AbstractEffect, Cut, ForceModel, effect_class, order_lines
from mjx_cutting.cutting.effects.entry_exit import part_of_arc
from mjx_cutting.tracing.along.kind import Kind
from mjx_cutting.tracing.fitting.model_lines import response, with_straight_teeth
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.records.course import Course
from mjx_cutting.tracing.records.lines import Lines, band_limit, heard_turns

NAME = "entry_exit"
NO_START_M, NO_END_M = -1.0, 1e3
SHARES = np.linspace(0.0, 1.0, 33) ** 2
"""[K] shares of the way in at which a cut that is not yet full is evaluated, most of them small."""
_STARTS = 25
_FIRST, _LAST = 0.3, 0.45
_EDGE = 0.05
_MISSING = 0.02
_ERRORS = 4.0
_LIKE_GEOMETRY = (0.4, 3.0)
_REACHES_APART = 1.05
_AT_ONCE = 1e-3
Array = NDArray[np.floating]


def entry_exit(lines: Lines, problem: Problem, model: ForceModel) -> Kind:
    """How the ends of the sheet are looked for beside a steady `model`; a shape is (start, end) m and whether
    they are met by the tool's axis, 1, or its rim, 0; which is one where all cuts are as deep."""
    ramps = Ramps(lines, problem, model)

    def columns(course: Course, shape: Array) -> Array:
        start, end, by_axis = (float(each) for each in shape)
        return ramps.missing(course, start, end, by_axis)[..., None]

    def grid(courses: Sequence[Course]) -> Array:
        (low, high), found = _ends(courses), []
        for by_axis in met_by(ramps.reach_m):
            late = by_axis * ramps.longest_m
            starts = np.linspace(low - ramps.longest_m + late, low + _FIRST * (high - low) + late, _STARTS)
            ends = np.linspace(high - _LAST * (high - low), high + late, _STARTS)
            found += [(start, np.inf, by_axis) for start in starts]
            found += [(-np.inf, end, by_axis) for end in ends]
        return np.array(found)

    return Kind(
        NAME, _missing_at_the_ends, grid, columns, effect_at, rather=_unlike_geometry, refine=_refined
    )


def effect_at(shape: Array, c: Array) -> AbstractEffect:
    """The effect with the ends `shape` [3], m (infinite where there is none), and the share `c` [1]."""
    start = float(shape[0]) if np.isfinite(shape[0]) else NO_START_M
    length = float(shape[1]) - start if np.isfinite(shape[1]) else NO_END_M
    return effect_class(NAME)(float(c[0]), start, length, by_axis=float(shape[2]))


def places_of(effect: AbstractEffect) -> tuple[float, float, float]:
    """Start and end of the sheet, m, infinite where it goes beyond the records; 1 if the axis meets them."""
    start, length, by_axis = (float(effect.values()[name]) for name in ("start_m", "length_m", "by_axis"))
    end = start + length if length < NO_END_M else np.inf
    return start if start > NO_START_M else -np.inf, end, by_axis


def like_geometry(effect: AbstractEffect) -> bool:
    """Whether about as much force is missing as where a tool enters or leaves a sheet."""
    low, high = _LIKE_GEOMETRY
    return low < float(effect.values()["share"]) < high


def _unlike_geometry(courses: Sequence[Course], effect: AbstractEffect) -> str:
    if like_geometry(effect):
        return ""
    return (
        f"{effect.values()['share']:.0%} of the force that a sheet's end takes away is missing, expected "
        f"{_LIKE_GEOMETRY[0]:.0%} or more and {_LIKE_GEOMETRY[1]:.0%} at most: it is something else at the "
        "ends of the path; begin and end the records where the tool cuts steadily"
    )


def _refined(grid: Array, here: Array, zoom: float) -> Array:
    """Both ends moved a little; at the first time also the other end, which the grid leaves out."""
    alike = grid[grid[:, 2] == here[2], :2]
    starts, ends = (np.unique(side[np.isfinite(side)]) for side in alike.T)
    steps = [float(np.diff(side[:2])[0]) / zoom for side in (starts, ends)]
    start, end, by_axis = (float(each) for each in here)
    near = [
        place + step * np.linspace(-1.0, 1.0, 7) if np.isfinite(place) else np.array([place])
        for place, step in zip((start, end), steps, strict=True)
    ]
    found = [(a, b) for a in near[0] for b in near[1]]
    if zoom <= 1.0:
        found += [(start, each) for each in ends] + [(each, end) for each in starts]
    return np.array([(a, b, by_axis) for a, b in found if b > a])


def _ends(courses: Sequence[Course]) -> tuple[float, float]:
    return min(float(c.position_m.min()) for c in courses), max(float(c.position_m.max()) for c in courses)


def _missing_at_the_ends(courses: Sequence[Course]) -> bool:
    """Whether force is missing over the first or the last of the paths, in all trials that go there."""
    low, high = _ends(courses)
    reach = _EDGE * (high - low)
    first = [_share(course, course.position_m < low + reach) for course in courses]
    last = [_share(course, course.position_m > high - reach) for course in courses]
    for side in (first, last):
        found = np.array([each for each in side if each is not None])
        error = float(np.std(found, ddof=1)) / np.sqrt(len(found)) if len(found) > 1 else np.inf
        if np.isfinite(error) and np.mean(found) < -max(_MISSING, _ERRORS * error):
            return True
    return False


def _share(course: Course, where: NDArray[np.bool_]) -> float | None:
    whole = (course.chip_n + course.edge_n)[where]
    energy = float(np.sum(whole**2))
    return float(np.sum(whole * course.left_n[where])) / energy if energy > 0.0 else None


def met_by(reach_m: Array) -> tuple[float, ...]:
    """What may meet the ends of the sheet, rim 0 and axis 1, where the ways in [R] tell the two apart."""
    return (0.0, 1.0) if float(np.max(reach_m)) > _REACHES_APART * float(np.min(reach_m)) else (0.0,)


def way_in_m(radial_depth_m: ArrayLike, diameter_m: float) -> NDArray[np.floating]:
    """[...] way from a tool's first touch of a sheet until its arc is full, m."""
    radius = 0.5 * diameter_m
    depth = np.clip(radial_depth_m, 1e-9, radius)
    return np.asarray(np.sqrt(depth * (2.0 * radius - depth)))


def ways(position_m: Array, reach_m: float, places: Sequence[float] | Array) -> tuple[Array, Array]:
    """[T] way into the sheet, and way out of it, as shares of `reach_m`: below nil before that, above one
    beyond. `places` as of `places_of`."""
    start_m, end_m, by_axis = places
    rim_m = position_m + by_axis * reach_m
    return (rim_m - start_m) / reach_m, (rim_m - end_m) / reach_m


def between_shares(way: Array) -> tuple[NDArray[np.int64], Array]:
    """[n] the last of `SHARES` behind ways [n] from 0 to 1, and how far each is on towards the next."""
    last = len(SHARES) - 1
    knot = np.minimum((np.sqrt(way) * last).astype(int), last - 1)
    return knot, (way * last**2 - knot**2) / (2 * knot + 1)


class Ramps:
    """Force missing at the ends of a sheet, in every trial."""

    def __init__(self, lines: Lines, problem: Problem, model: ForceModel):
        self.lines, self.problem, self.model = lines, problem, model
        self._latest: tuple[Course, Array] | None = None
        self.reach_m = way_in_m(
            np.asarray(problem.cut.radial_depth_m), float(np.asarray(model.tool.diameter_m))
        )
        self.longest_m = float(self.reach_m.max())

    @cached_property
    def entering(self) -> NDArray[np.complexfloating]:
        """[R, K, orders + 1, 3] lines while the rim has gone in by `SHARES` of its way."""
        return np.asarray(
            _lines(self.problem, self.model, jnp.asarray(1.0 - SHARES), jnp.asarray(self.reach_m))
        )

    def whole(self, trial: int) -> NDArray[np.complexfloating]:
        """[orders + 1, 3] lines of a trial fully in the sheet."""
        return self.entering[trial, -1]

    def missing(
        self, course: Course, start_m: float, end_m: float, by_axis: float = 0.0, at_once: bool = False
    ) -> Array:
        """[T, 3] what the force lacks, N: minus the whole of it outside the sheet. `at_once`: of a tool that
        is all in or all out, as one that is lowered into the sheet."""
        reach, added = self.reach_m[course.index], np.zeros_like(course.left_n)
        way_in, way_out = ways(course.position_m, reach, (start_m, end_m, by_axis))
        if at_once:
            way_in, way_out = way_in / _AT_ONCE, way_out / _AT_ONCE
        # a tooth has left the sheet where it would already have been in one that begins there
        in_ramp, out_ramp = way_in < 1.0, way_out > 0.0
        if in_ramp.any():
            way = np.clip(way_in[in_ramp], 0.0, 1.0)
            added[in_ramp] += self._wave(course, in_ramp, way) - self._at_knots(course)[in_ramp, -1]
        if out_ramp.any():
            added[out_ramp] -= self._wave(course, out_ramp, np.clip(way_out[out_ramp], 0.0, 1.0))
        return band_limit(added, course.rate_hz, course.band_hz)

    def _wave(self, course: Course, ramp: NDArray[np.bool_], way: Array) -> Array:
        """[n, 3] force at the samples of a `ramp` [T] after shares of the way in, between two knots."""
        knot, after = between_shares(way)
        at_knots, sample = self._at_knots(course), np.flatnonzero(ramp)
        near, next_ = at_knots[sample, knot], at_knots[sample, knot + 1]
        return near + after[:, None] * (next_ - near)

    def _at_knots(self, course: Course) -> Array:
        """[T, K, 3] force all along the trial asked last after each of the shares of the way in."""
        if self._latest is None or self._latest[0] is not course:
            turns = heard_turns(self.lines, course.index, course.angle_rad)
            lines = np.moveaxis(self.entering[course.index], 0, 1)
            flat = lines.reshape(len(lines), -1)
            wave = turns.real @ flat.real - turns.imag @ flat.imag
            self._latest = course, wave.reshape(len(turns), *lines.shape[1:])
        return self._latest[1]


@eqx.filter_jit
def _lines(problem: Problem, model: ForceModel, missing: jax.Array, reach_m: jax.Array) -> jax.Array:
    """[R, K, orders + 1, 3] lines of every trial with shares [K] of the way in, [R], still to go."""
    straight = with_straight_teeth(problem, model)
    radius = 0.5 * jnp.asarray(problem.tool.diameter_m)

    def one(cut: Cut, gain: jax.Array, reach: jax.Array, missing: jax.Array) -> jax.Array:
        part = part_of_arc(cut, missing * reach / radius)
        lines = order_lines(straight, part, problem.orders, problem.angles, problem.arc_rad)
        return lines * gain[..., None]

    many = jax.vmap(one, in_axes=(None, None, None, 0))
    return jax.vmap(many, in_axes=(0, 0, 0, None))(problem.cut, response(problem, model), reach_m, missing)
