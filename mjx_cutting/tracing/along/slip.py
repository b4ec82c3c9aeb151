"""By how much a spindle that gives way is ahead of an even turn, on the ramps at the ends of the sheet.

Its speed is that which the motor's droop has it turn at under the load that geometry leaves of the full one,
after a lag of first order with which the motor gives way. In the full cut it turns evenly; from there the
phase walks, by whole pitches on a long ramp. Droop, lag and the ends of the sheet are looked for together,
where tooth passing agrees best with what was measured on the ramps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.signal import lfilter

from mjx_cutting.cutting import ForceModel
from mjx_cutting.cutting.average import mean_load
from mjx_cutting.cutting.effects.entry_exit import part_of_arc
from mjx_cutting.cutting.effects.spindle_droop import SpindleDroop
from mjx_cutting.tracing.along.ends import SHARES, Ramps, between_shares, way_in_m, ways
from mjx_cutting.tracing.fitting.moving import wave
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.records.course import Course
from mjx_cutting.tracing.records.turns import turns

_STIFFER = np.linspace(0.5, 2.0, 61)
_LAGS_S = np.linspace(0.0, 0.5, 11)
_STEP = 0.02
_TRIES, _TRIES_OF_A_FOLD = 300, 60
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Slip:
    """How spindle and sheet are. Fields: `places` [3], the ends of the sheet as of `ends.places_of`; `droop`,
    rev/s/(N m); `lag_s`."""

    places: Array
    droop: float
    lag_s: float

    def moved(self, by: Array, reach_m: float) -> Slip:
        """With both ends further by shares of the way in, a droop larger by one, the lag longer by some s."""
        places = self.places + reach_m * np.array([by[0], by[1], 0.0])
        return Slip(places, self.droop * float(np.exp(by[2])), max(self.lag_s + float(by[3]), 0.0))


def loads(problem: Problem, model: ForceModel) -> tuple[Array, Array]:
    """[R, K] torque of the edge, N m, and of the chip times the speed, N m rev/s, which does not depend on
    it, of every trial with `SHARES` of the way in behind it."""
    diameter_m = float(np.asarray(problem.tool.diameter_m))
    reach_m = way_in_m(np.asarray(problem.cut.radial_depth_m), diameter_m)
    cut = jax.tree.map(lambda leaf: jnp.asarray(leaf)[:, None], problem.cut)
    part = part_of_arc(cut, np.multiply.outer(reach_m, 1.0 - SHARES) / (0.5 * diameter_m))
    rigid = tuple(each for each in model.effects if not isinstance(each, SpindleDroop))
    load = mean_load(ForceModel(problem.tool, model.material, rigid), part)
    return np.asarray(load.edge_torque), np.asarray(load.chip_torque * cut.spindle_speed_rev_s)


@dataclass(frozen=True, eq=False)
class Slipping:
    """A whole record as the spindle's load and the phase of tooth passing have it.

    Fields:
        course, ramps: the record, what is left of it beside an even turn fully in the sheet.
        where: [T] not traced in the full cut, and so judged here.
        edge, chip: [K] its loads as of `loads`.
        force: [n, 3] measured less the bias where it is judged, N.
        lines: [K, M, 3] lines of tooth passing by `SHARES` of the way in, N.
    """

    course: Course
    ramps: Ramps
    where: NDArray[np.bool_]
    edge: Array
    chip: Array
    force: Array
    lines: NDArray[np.complexfloating]

    @classmethod
    def of(cls, course: Course, ramps: Ramps, where: NDArray[np.bool_], edge: Array, chip: Array) -> Slipping:
        """From a record and its loads; arguments as the fields."""
        index, teeth = course.index, ramps.problem.tool.teeth
        full = wave(ramps.lines, index, course.angle_rad, ramps.whole(index), course.rate_hz)
        heard = np.concatenate([[1.0], 2.0 * ramps.lines.present[index][1::2]])
        passing = (ramps.entering[index] * heard[:, None])[:, ::teeth]
        return cls(course, ramps, where, edge, chip, (course.left_n + full)[where], passing)

    @property
    def reach_m(self) -> float:
        """Way from the first touch until the tool is fully engaged, m."""
        return float(self.ramps.reach_m[self.course.index])

    def ahead(self, of: Slip) -> Array:
        """[T] by how much further than evenly turned the tool is, rad."""
        way_in, way_out = self._ways(of)
        edge, chip = (
            np.interp(way_in, SHARES, each) - np.interp(way_out, SHARES, each)
            for each in (self.edge, self.chip)
        )
        full, rate_hz = float(self.ramps.lines.speed_rev_s[self.course.index]), self.course.rate_hz
        free = full + of.droop * (self.edge[-1] + self.chip[-1] / full)
        speed = np.asarray(SpindleDroop(of.droop).speed_under(free, edge, chip))
        if of.lag_s > 0.0:
            keep = np.exp(-1.0 / (rate_hz * of.lag_s))
            speed, _ = lfilter([1.0 - keep], [1.0, -keep], speed, zi=[keep * speed[0]])
        further = 2.0 * np.pi / rate_hz * np.cumsum(speed - full)
        # the even turn was fitted to the part traced, and has taken there what is straight of this
        time, traced = self.course.time_s, ~self.where
        even = np.polyfit(time[traced], further[traced], 1)
        return np.asarray(further - np.polyval(even, time))

    def left(self, of: Slip, weight: Array) -> float:
        """Weighted squared error of tooth passing where the record is judged."""
        way_in, way_out = (each[self.where] for each in self._ways(of))
        cut = (way_in > 0.0) & (way_out < 1.0)
        angle = (self.course.angle_rad + self.ahead(of))[self.where]
        turned = turns(self.ramps.problem.tool.teeth * angle[cut], self.lines.shape[1] - 1)
        lines = self._lines_at(way_in[cut]) - self._lines_at(way_out[cut])
        left = self.force.copy()
        left[cut] -= np.real(np.einsum("mt,tma->ta", turned, lines))
        return float(np.sum((left * weight) ** 2))

    def _ways(self, of: Slip) -> tuple[Array, Array]:
        """[T] shares of the way in, and of the way out, that are behind the tool."""
        way_in, way_out = ways(self.course.position_m, self.reach_m, of.places)
        return np.clip(way_in, 0.0, 1.0), np.clip(way_out, 0.0, 1.0)

    def _lines_at(self, way: Array) -> NDArray[np.complexfloating]:
        knot, after = between_shares(way)
        near, next_ = self.lines[knot], self.lines[knot + 1]
        return near + after[:, None, None] * (next_ - near)


def closest_slip(
    records: Sequence[Slipping], first: Slip, weight: Array, fold: NDArray[np.int64]
) -> tuple[Slip, list[Slip]]:
    """What leaves least on all ramps, and without each fold of the trials [R]: near the ends and about the
    droop of the `first`."""
    grid = [Slip(first.places, first.droop * each, lag) for each in _STIFFER for lag in _LAGS_S]
    likely = min(grid, key=lambda one: sum(each.left(one, weight) for each in records))
    best = _descended(records, likely, weight, _TRIES)
    by_fold = []
    for f in range(int(fold.max()) + 1):
        rest = [each for each, own in zip(records, fold, strict=True) if own != f]
        by_fold.append(_descended(rest, best, weight, _TRIES_OF_A_FOLD))
    return best, by_fold


def _descended(records: Sequence[Slipping], near: Slip, weight: Array, tries: int) -> Slip:
    """What leaves least, from what is `near` it, after so many tries."""
    reach_m = min(each.reach_m for each in records)
    known = np.flatnonzero(np.append(np.isfinite(near.places[:2]), [True, True]))

    def moved(by: Array) -> Slip:
        whole = np.zeros(4)
        whole[known] = by
        return near.moved(whole, reach_m)

    def left(by: Array) -> float:
        return sum(each.left(moved(by), weight) for each in records)

    start = np.zeros(len(known))
    simplex = np.vstack([start, _STEP * np.eye(len(known))])
    ends = {"initial_simplex": simplex, "maxfev": tries, "xatol": 1e-3, "fatol": 1e-4 * left(start)}
    return moved(minimize(left, start, method="Nelder-Mead", options=ends).x)
