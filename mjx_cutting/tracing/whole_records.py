"""Whole records beside a model that was traced on the part of them in which the tool is fully in the sheet.

What the geometry of entry and exit says is missing elsewhere is held against the force measured there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.along.ends import Ramps
from mjx_cutting.tracing.along.slow_round import SlowCandidate, SlowRound
from mjx_cutting.tracing.along.slow_try import FEWEST_REACHED
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.moving import wave
from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.naming.chance import chance_over_trials
from mjx_cutting.tracing.naming.decision import decide
from mjx_cutting.tracing.naming.intervals import Interval
from mjx_cutting.tracing.passes import Pass
from mjx_cutting.tracing.records.course import Course, felt_at
from mjx_cutting.tracing.records.line_gain import filter_delay_s
from mjx_cutting.tracing.records.lines import band_limit
from mjx_cutting.tracing.records.spindle import spindle_angle
from mjx_cutting.trials.dataset import Dataset, Trial

_HARDLY = 1e-3
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Outside:
    """A whole record as predicted fully engaged, to be judged where the tool was not fully in the sheet.

    Fields: `course`, its `left_n` nil elsewhere and the measured force in place of the edge's; `ramps` under
    the model fitted without this trial; `where` [T] it is judged.
    """

    course: Course
    ramps: Ramps
    where: NDArray[np.bool_]

    @property
    def reach_m(self) -> float:
        """Way from the first touch until the tool is fully engaged, m."""
        return float(self.ramps.reach_m[self.course.index])

    def turned(self, further_rad: Array) -> Outside:
        """The record with its tool further by [T] rad than it was taken to be."""
        was, ramps = self.course, self.ramps
        full = ramps.whole(was.index)
        angle = was.angle_rad + further_rad
        steady, slipped = (
            wave(ramps.lines, was.index, each, full, was.rate_hz) for each in (was.angle_rad, angle)
        )
        left = was.left_n + (steady - slipped) * self.where[:, None]
        return replace(self, course=replace(was, angle_rad=angle, left_n=left))

    def missing(self, ends: Array, at_once: bool = False) -> Array:
        """[T, 3] what the force lacks there for a sheet with these ends, N; `at_once`: see `Ramps`."""
        start, end, by_axis = (float(each) for each in ends)
        return self.ramps.missing(self.course, start, end, by_axis, at_once) * self.where[:, None]


def outside_the_cut(dataset: Dataset, inside: Pass) -> list[Outside]:
    """Every whole record of which a part was traced inside the sheet."""
    fits, fold, lines = inside.search.final.fits, inside.search.final.fold, inside.lines
    assert fits is not None
    models = [jax.tree.map(lambda leaf, f=f: leaf[f], fits.model) for f in range(int(fold.max()) + 1)]
    ramps = [Ramps(lines, inside.search.problem, model) for model in models]
    rate = dataset.sensor.sample_rate_hz
    found = []
    cuts = {trial.file: trial for trial in _cuts(dataset)}
    pairs = [
        (cuts[cut.file], cut, told) for cut, told in zip(_cuts(inside.dataset), inside.after, strict=True)
    ]
    for index, (trial, cut, told) in enumerate(pairs):
        turned = spindle_angle(trial, told.speed_rev_s)
        first = int(np.searchsorted(trial.time_s, cut.time_s[0]))
        traced = slice(first, first + len(cut.time_s))
        angle = turned + told.angle_rad[0] - turned[first]
        # within the part traced the spindle's own way is known, and goes on from there
        angle[traced.stop :] += told.angle_rad[-1] - angle[traced.stop - 1]
        angle[traced] = told.angle_rad
        steady = wave(lines, index, angle, ramps[fold[index]].whole(index), rate)
        measured = band_limit(trial.force_n, rate, lines.band_hz)
        # the part traced may have been brought to a zero of its own
        zero = (trial.force_n[traced] - cut.force_n).mean(axis=0)
        left = measured - zero - told.bias_n - steady
        where = np.ones(len(left), bool)
        where[traced] = False
        course = Course(
            time_s=trial.time_s - trial.time_s[0],
            position_m=felt_at(trial, filter_delay_s(dataset.sensor)),
            feed_share=None,
            chip_n=np.zeros_like(measured),
            edge_n=measured,
            left_n=left * where[:, None],
            rate_hz=rate,
            band_hz=lines.band_hz,
            index=index,
            angle_rad=angle,
        )
        found.append(Outside(course, ramps[fold[index]], where))
    return found


def left_of(outside: Sequence[Outside], ends: Array, weight: Array, at_once: bool = False) -> float:
    """Weighted squared error that is left there for a sheet with these ends."""
    left = (each.course.left_n - each.missing(ends, at_once) for each in outside)
    return sum(float(np.sum((each * weight) ** 2)) for each in left)


def closest(
    outside: Sequence[Outside], tried: Sequence[Array] | Array, weight: Array, at_once: bool = False
) -> Array:
    """The ends of a sheet, of those `tried`, that leave least there."""
    left = np.zeros(len(tried))
    # record by record, because each has its waves computed for the ends asked one after another
    for record in outside:
        left += [left_of([record], ends, weight, at_once) for ends in tried]
    return np.asarray(tried[int(np.argmin(left))])


@dataclass(frozen=True, eq=False)
class Told:
    """What the ends of the sheet tell of whole records.

    Fields: error on held-out trials `before` and `after`; the `share` of the geometry that the trials show,
    and `by_fold` [F] that of all others; `samples` of the records; `reached` [R] those that show an end at
    all, which alone say something for it or against.
    """

    before: HeldOut
    after: HeldOut
    share: float
    by_fold: Array
    samples: int
    reached: NDArray[np.bool_]

    def noise_over(self, inside: Pass) -> float:
        """Share of noise in whole records over that in the parts of them that were traced."""
        lines = inside.lines
        whole = self.before.energy_n2.sum() / self.samples
        return float(np.sqrt(lines.energy_n2.sum() / lines.samples.sum() / whole))

    def round(
        self,
        effect: AbstractEffect,
        parameters: dict[str, Interval],
        predicted: Sequence[Prediction],
        tries: int,
    ) -> SlowRound:
        """The effect as decided on whole records, as a round of its own among `tries` effects."""
        kind = type(effect)
        p = chance_over_trials(self.before.only(self.reached), self.after.only(self.reached), tries)
        decision = decide(kind, self.before, self.after, p, parameters)
        silent = tuple(np.zeros_like(each.measured_n) for each in predicted)
        candidate = SlowCandidate(kind, effect, self.after, decision, silent)
        return SlowRound(self.before, (candidate,), candidate if decision.accepted else None)


def held_against(columns: Sequence[Array], outside: Sequence[Outside], final: HeldOut, weight: Array) -> Told:
    """The share of what is missing, `columns` [T, 3] by trial, N, that whole records show.

    Each held-out trial is judged by that of the others.

    Arguments:
        final: error on held-out trials where the tool is fully in the sheet.
        weight: [3] 1 / standard deviation of each axis.
    """
    courses = [each.course for each in outside]
    product = np.array(
        [np.sum(x * each.left_n * weight**2) for x, each in zip(columns, courses, strict=True)]
    )
    square = np.array([np.sum(x * x * weight**2) for x in columns])
    others = [final.fold != f for f in range(int(final.fold.max()) + 1)]
    by_fold = np.array([product[rest].sum() / max(square[rest].sum(), 1e-300) for rest in others])
    share = float(product.sum() / max(square.sum(), 1e-300))
    energy = np.stack([np.sum((each.chip_n + each.edge_n) ** 2, axis=0) for each in courses])
    bare = np.stack([np.sum(each.left_n**2, axis=0) for each in courses])
    rows = zip(courses, columns, by_fold[final.fold], strict=True)
    told = np.stack([np.sum((each.left_n - own * x) ** 2, axis=0) for each, x, own in rows])
    before = HeldOut(final.error_n2 + bare, energy, None, final.fold)
    after = HeldOut(final.error_n2 + told, energy, None, final.fold)
    shown = square > _HARDLY * square.max(initial=0.0)
    reached = shown if shown.sum() >= FEWEST_REACHED else np.ones(len(shown), bool)
    return Told(before, after, share, by_fold, sum(len(each.time_s) for each in courses), reached)


def with_ends(inside: Pass, named: SlowRound, told: Told, sentence: str, base_n2: Array) -> Pass:
    """The pass with the ends of the sheet as accepted on whole records, of which all its errors then are.

    Arguments: `sentence` of evidence; `base_n2` [R, 3] squared error of the base model on whole records.
    """
    found = replace(inside.with_round(named, (sentence,)), noise_over=told.noise_over(inside))
    base = HeldOut(base_n2, named.before.energy_n2, None, inside.search.base.fold)
    return replace(found, search=replace(found.search, base=base))


def met(start_m: float, by_axis: float) -> str:
    """Where a tool meets its sheet, in words that follow its name."""
    return f"its {'axis' if by_axis else 'rim'} meets {1e3 * start_m:.2f} mm along the path"


def _cuts(dataset: Dataset) -> list[Trial]:
    return [trial for trial in dataset.trials if trial.kind == "cut"]
