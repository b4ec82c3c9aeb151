"""A spindle that gives way, on the ramps at the ends of the sheet: it slows as the cut builds up.

In the full cut a loaded spindle turns evenly, and its lines stand where that was. On the way in it comes down
from its free speed, on the way out it goes up to it again, so that the phase of the teeth walks against that
of the full cut, by whole pitches on a long ramp. Where it is follows from the motor's droop, from the load
that geometry leaves of the full one, and from a lag of first order with which the motor gives way. Droop, lag
and the ends of the sheet are looked for together on the ramps, where the phase of tooth passing tells the
droop far better than the speeds of whole cuts do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.signal import lfilter

from mjx_cutting.cutting import ForceModel, effect_class
from mjx_cutting.cutting.average import mean_load
from mjx_cutting.cutting.effects.spindle_droop import SpindleDroop
from mjx_cutting.tracing.along.droop import NAME as DROOP
from mjx_cutting.tracing.along.ends import NAME as ENDS
from mjx_cutting.tracing.along.ends import effect_at, part_of_arc, places_of
from mjx_cutting.tracing.along.slow_round import SlowRound
from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.moving import wave
from mjx_cutting.tracing.fitting.prediction import Prediction, predictions
from mjx_cutting.tracing.fitting.problem import Problem, pose, shared_bias
from mjx_cutting.tracing.naming.decision import gain_over_trials, interval
from mjx_cutting.tracing.passes import Pass
from mjx_cutting.tracing.records.lines import compress, turns
from mjx_cutting.tracing.records.spindle import spindle_angle
from mjx_cutting.tracing.telling.verdict import final
from mjx_cutting.tracing.whole_records import Outside, held_against, met, outside_the_cut
from mjx_cutting.trials.dataset import Dataset

_SHARES = np.linspace(0.0, 1.0, 65) ** 2
_STIFFER = np.linspace(0.5, 2.0, 61)
_LAGS_S = np.linspace(0.0, 0.5, 11)
_STEP = 0.02
_STEPS, _FOLD_STEPS = 300, 60
_ALIKE = 0.01
_CLEARLY = 2.0
_DROOP_AND_ENDS = 2
Array = NDArray[np.floating]


def with_droop_on_ramps(whole: Dataset, found: Pass) -> Pass:
    """The pass with the ends of the sheet held against whole records anew, the spindle slowing there as its
    droop has it, and that droop as the ramps tell it; `found` where they do not clearly say so.

    Arguments: `whole` the records; `found` in the cut, with droop first of what was found along the trials
        and the ends of the sheet last.
    """
    accepted = [each.accepted for each in found.slow]
    droop, ends = (accepted[0], accepted[-1]) if len(accepted) > 1 else (None, None)
    if droop is None or ends is None or (droop.kind.name, ends.kind.name) != (DROOP, ENDS):
        return found
    inside, weight = final(found.search, found.slow[1:-1]), np.asarray(found.search.problem.weight)
    outside, places = outside_the_cut(whole, found), np.array(places_of(ends.effect))
    even = held_against([each.missing(places) for each in outside], outside, inside, weight)
    if abs(even.after.nrmse - ends.heldout.nrmse) > _ALIKE * ends.heldout.nrmse:
        # where they begin and end is each record's own
        return found
    load = _loads(found.search.problem, found.model)
    records = [_Record.of(each, load) for each in outside]
    first = _Slip(places, float(droop.effect.values()["droop_rev_s_nm"]), 0.0)
    fold, folds = inside.fold, range(int(inside.fold.max()) + 1)
    best = _closest(records, _likely(records, first, weight), weight, _STEPS)
    by_fold = []
    for f in folds:
        rest = [each for each, own in zip(records, fold, strict=True) if own != f]
        by_fold.append(_closest(rest, best, weight, _FOLD_STEPS))
    slips = [by_fold[f] for f in fold]
    turned = [each.turned(own.slip(slip)) for each, own, slip in zip(outside, records, slips, strict=True)]
    missing = [each.missing(slip.places) for each, slip in zip(turned, slips, strict=True)]
    followed = [own.slip(slip)[own.traced] for own, slip in zip(records, slips, strict=True)]
    inside, after = _followed(found, inside, followed)
    told = held_against(missing, turned, inside, weight)
    gain, error = gain_over_trials(even.after, told.after)
    if not gain > _CLEARLY * error:
        return found
    stiffness = interval(
        droop.kind,
        "droop_rev_s_nm",
        best.droop,
        np.array([each.droop for each in by_fold]),
        # the torque is known no better than the force is
        model_error=best.droop * told.after.nrmse,
    )
    start = interval(ends.kind, "start_m", best.places[0], np.array([each.places[0] for each in by_fold]))
    slowed = effect_class(DROOP)(best.droop)
    sheet = effect_at(best.places, np.array([told.share]))
    parameters = ends.decision.parameters | {
        "share": interval(ends.kind, "share", told.share, told.by_fold),
        "start_m": start,
    }
    known = replace(
        droop, effect=slowed, decision=replace(droop.decision, parameters={"droop_rev_s_nm": stiffness})
    )
    new = replace(
        ends, effect=sheet, heldout=told.after, decision=replace(ends.decision, parameters=parameters)
    )
    said = (
        f"on the ramps at the ends of the sheet the spindle gives way with a lag of {best.lag_s:.2g} s; the "
        "phase of the teeth there tells how far"
    )
    was, now = (met(float(each[0]), float(each[2])) for each in (places, best.places))
    placed = [each.replace(was, now) for each in found.evidence.get(ENDS, ())]
    others = tuple(each for each in found.model.effects if each.name not in (DROOP, ENDS))
    return replace(
        found,
        after=after,
        model=ForceModel(found.model.tool, found.model.material, (*others, slowed, sheet)),
        slow=(
            replace(found.slow[0], candidates=(known,), accepted=known),
            *found.slow[1:-1],
            SlowRound(told.before, (new,), new),
        ),
        evidence=found.evidence | {DROOP: (*found.evidence.get(DROOP, ()), said), ENDS: tuple(placed)},
    )


def _followed(
    found: Pass, inside: HeldOut, further_rad: Sequence[Array]
) -> tuple[HeldOut, tuple[Prediction, ...]]:
    """Error on held-out trials in the cut, and predictions there, where every tool is by [T] rad further than
    evenly turned: a spindle that lags is still slowing as its tool is fully in."""
    if len(found.slow) > _DROOP_AND_ENDS:
        # what stands beside the lines was found on an even turn
        return inside, found.after
    rest, speeds, trials = iter(further_rad), iter(found.lines.speed_rev_s), []
    for trial in found.dataset.trials:
        if trial.kind == "cut":
            angle = spindle_angle(trial, float(next(speeds))) + next(rest)
            trial = replace(trial, spindle_angle_rad=angle)
        trials.append(trial)
    dataset = replace(found.dataset, trials=tuple(trials))
    lines = compress(dataset, found.lines.band_hz, found.lines.speed_rev_s, like=found.lines)
    problem, fits = pose(dataset, lines), inside.fits
    assert fits is not None
    again = Descent(problem, found.search.effects).fits(
        np.asarray(fits.x), np.ones((len(fits.x), problem.trials))
    )
    error = np.asarray(again.error_n2)[inside.fold, np.arange(problem.trials)] + lines.rest_n2
    bias = shared_bias(found.search.problem, found.search.final_fit.x)
    after = predictions(dataset, lines, problem, found.search.final_fit.model, bias)
    return HeldOut(error, inside.energy_n2, fits, inside.fold), after


@dataclass(frozen=True, eq=False)
class _Slip:
    """How spindle and sheet are. Fields: `places` [3], the ends of the sheet as of `effect_at`; `droop`,
    rev/s/(N m); `lag_s`."""

    places: Array
    droop: float
    lag_s: float

    def moved(self, by: Array, reach_m: float) -> _Slip:
        """With both ends further by shares of the way in, a droop larger by one, the lag longer by some s."""
        places = self.places + reach_m * np.array([by[0], by[1], 0.0])
        return _Slip(places, self.droop * float(np.exp(by[2])), max(self.lag_s + float(by[3]), 0.0))


@dataclass(frozen=True, eq=False)
class _Loads:
    """Torque of every trial with shares of the way in behind it: [R, K] of the `edge`, N m, and of the chip
    times the speed, `chip`, N m rev/s, which does not depend on the speed."""

    edge: Array
    chip: Array


def _loads(problem: Problem, model: ForceModel) -> _Loads:
    radius = 0.5 * jnp.asarray(problem.tool.diameter_m)
    cut = jax.tree.map(lambda leaf: jnp.asarray(leaf)[:, None], problem.cut)
    depth = jnp.clip(jnp.asarray(cut.radial_depth_m), 1e-9, radius)
    reach = jnp.sqrt(depth * (2.0 * radius - depth))
    rigid = tuple(each for each in model.effects if each.name != DROOP)
    load = mean_load(
        ForceModel(problem.tool, model.material, rigid), part_of_arc(cut, (1.0 - _SHARES) * reach / radius)
    )
    return _Loads(np.asarray(load.edge_torque), np.asarray(load.chip_torque * cut.spindle_speed_rev_s))


@dataclass(frozen=True, eq=False)
class _Record:
    """A whole record as the spindle's load and the phase of tooth passing have it.

    Fields: `rim_m` [T] where the rim is, if it meets the sheet, and `reach_m` its way in; torques [K] by its
    shares as of `_Loads`; `speed` in the full cut, rev/s; `rate_hz`; [T] its times and where it was `traced`;
    `judged` [n] the others; their `angle` in an even turn, the `force` [n, 3] measured less the bias, N;
    lines of tooth passing [K', M, 3] by shares of the way, of `teeth` teeth.
    """

    position_m: Array
    reach_m: float
    edge: Array
    chip: Array
    speed: float
    rate_hz: float
    time_s: Array
    traced: NDArray[np.bool_]
    judged: NDArray[np.int64]
    angle: Array
    force: Array
    lines: NDArray[np.complexfloating]
    teeth: int

    @classmethod
    def of(cls, record: Outside, loads: _Loads) -> _Record:
        course, ramps = record.course, record.ramps
        index, judged, teeth = course.index, np.flatnonzero(record.where), ramps.problem.tool.teeth
        full = wave(ramps.lines, index, course.angle_rad, ramps.whole(index), course.rate_hz)
        heard = np.concatenate([[1.0], 2.0 * ramps.lines.present[index][1::2]])
        return cls(
            position_m=course.position_m,
            reach_m=record.reach_m,
            edge=loads.edge[index],
            chip=loads.chip[index],
            speed=float(ramps.lines.speed_rev_s[index]),
            rate_hz=course.rate_hz,
            time_s=course.time_s,
            traced=~record.where,
            judged=judged,
            angle=course.angle_rad[judged],
            force=(course.left_n + full)[judged],
            lines=(ramps.entering[index] * heard[:, None])[:, ::teeth],
            teeth=teeth,
        )

    def slip(self, of: _Slip) -> Array:
        """[T] by how much further than evenly turned the tool is, rad."""
        way_in, way_out = self._ways(of.places)
        edge, chip = (
            np.interp(way_in, _SHARES, each) - np.interp(way_out, _SHARES, each)
            for each in (self.edge, self.chip)
        )
        motor = SpindleDroop(of.droop)
        free = self.speed + of.droop * (self.edge[-1] + self.chip[-1] / self.speed)
        speed = np.asarray(motor.speed_under(free, edge, chip))
        if of.lag_s > 0.0:
            keep = np.exp(-1.0 / (self.rate_hz * of.lag_s))
            speed, _ = lfilter([1.0 - keep], [1.0, -keep], speed, zi=[keep * speed[0]])
        further = 2.0 * np.pi / self.rate_hz * np.cumsum(speed - self.speed)
        # the even turn was fitted to the part traced, and has taken there what is straight of this
        even = np.polyfit(self.time_s[self.traced], further[self.traced], 1)
        return np.asarray(further - np.polyval(even, self.time_s))

    def left(self, of: _Slip, weight: Array) -> float:
        """Weighted squared error of tooth passing where the record is judged."""
        way_in, way_out = (each[self.judged] for each in self._ways(of.places))
        cut = (way_in > 0.0) & (way_out < 1.0)
        left = self.force.copy()
        turned = turns(self.teeth * (self.angle + self.slip(of)[self.judged])[cut], self.lines.shape[1] - 1)
        lines = self._at(way_in[cut]) - self._at(way_out[cut])
        left[cut] -= np.real(np.einsum("mt,tma->ta", turned, lines))
        return float(np.sum((left * weight) ** 2))

    def _ways(self, places: Array) -> tuple[Array, Array]:
        """[T] shares of the way in, and of the way out, that are behind the tool."""
        start, end, by_axis = places
        rim = self.position_m + by_axis * self.reach_m
        into = np.clip((rim - start) / self.reach_m, 0.0, 1.0) if np.isfinite(start) else np.ones_like(rim)
        out = np.clip((rim - end) / self.reach_m, 0.0, 1.0) if np.isfinite(end) else np.zeros_like(rim)
        return into, out

    def _at(self, way: Array) -> NDArray[np.complexfloating]:
        """[n, M, 3] lines of tooth passing after shares [n] of the way in, straight between two of those."""
        place = np.sqrt(way) * (len(self.lines) - 1)
        knot = np.minimum(place.astype(int), len(self.lines) - 2)
        after = ((place**2 - knot**2) / (2 * knot + 1))[:, None, None]
        return (1.0 - after) * self.lines[knot] + after * self.lines[knot + 1]


def _likely(records: Sequence[_Record], first: _Slip, weight: Array) -> _Slip:
    """Droop and lag on a grid about the droop of the `first`, at its ends of the sheet."""
    grid = [_Slip(first.places, first.droop * each, lag) for each in _STIFFER for lag in _LAGS_S]
    return min(grid, key=lambda one: sum(each.left(one, weight) for each in records))


def _closest(records: Sequence[_Record], near: _Slip, weight: Array, steps: int) -> _Slip:
    """Ends of the sheet, droop and lag that leave least, from those `near`, after so many trials of them."""
    reach_m = min(each.reach_m for each in records)
    known = np.flatnonzero(np.append(np.isfinite(near.places[:2]), [True, True]))

    def moved(by: Array) -> _Slip:
        whole = np.zeros(4)
        whole[known] = by
        return near.moved(whole, reach_m)

    def left(by: Array) -> float:
        return sum(each.left(moved(by), weight) for each in records)

    start = np.zeros(len(known))
    simplex = np.vstack([start, _STEP * np.eye(len(known))])
    ends = {"initial_simplex": simplex, "maxfev": steps, "xatol": 1e-3, "fatol": 1e-4 * left(start)}
    return moved(minimize(left, start, method="Nelder-Mead", options=ends).x)
