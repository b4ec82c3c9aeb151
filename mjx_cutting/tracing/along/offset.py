"""Time offset, named from the phases: by how much the force lags the measured angle at each speed.

A fit leaves the phase of every trial free, at which its teeth stand at the measured angle. That is the zero
of the encoder, the same in all trials; if the force is late by a time D, it goes with the speed f:

    phase = zero - 2 pi f D, known but for whole teeth

What names the offset is a delay that brings the phases of all trials together as chance would not. Held-out
error: "before" is scored with every trial at the zero that the others have in common, "after" where the
others' zero and delay put it. A trial that does not tell its phase says nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from mjx_cutting.cutting import ForceModel, effect_class
from mjx_cutting.tracing.along.slow_round import BeforeOthers, SlowCandidate, SlowRound
from mjx_cutting.tracing.fitting.fit import Fit
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.prediction import Prediction, predictions
from mjx_cutting.tracing.fitting.problem import shared_bias
from mjx_cutting.tracing.naming.decision import decide
from mjx_cutting.tracing.naming.intervals import interval
from mjx_cutting.tracing.naming.search import Search
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import Lines
from mjx_cutting.tracing.records.spindle import spindle_angle
from mjx_cutting.trials.dataset import Dataset, Trial

NAME = "time_offset"
_FEWEST = 4
_SPEEDS_APART = 1.05
_STEPS_A_TOOTH = 32
_AS_GOOD = 2.0
_SURE_RAD = 1e-4
_SURELY = 10.0
Array = NDArray[np.floating]


def delay_s(model: ForceModel) -> float:
    """By how much the force of a model is late, s."""
    return sum(float(np.asarray(each.values()["delay_s"])) for each in model.effects if each.name == NAME)


def as_late(dataset: Dataset, delay_s: float) -> Dataset:
    """The trials with place, feed and spindle speed as they were when the force was made that is recorded by
    so much later; the angle is as it was, which tells the delay."""

    def late(trial: Trial) -> Trial:
        def then(value: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.interp(trial.time_s - delay_s, trial.time_s, value)

        place = trial.position_m
        feed, speed = trial.feed_speed_measured_m_s, trial.spindle_speed_measured_rev_s
        return replace(
            trial,
            position_m=None if place is None else np.stack([then(axis) for axis in place.T], axis=-1),
            feed_speed_measured_m_s=None if feed is None else then(feed),
            spindle_speed_measured_rev_s=None if speed is None else then(speed),
        )

    return replace(dataset, trials=tuple(map(late, dataset.trials)))


def find_offset(
    dataset: Dataset,
    lines: Lines,
    found: Search,
    final: HeldOut,
    before: Sequence[Prediction],
    after: Sequence[Prediction],
) -> BeforeOthers | None:
    """A delay of the force beside all else that was found (call it in float64); None where the trials cannot
    tell one.

    Arguments:
        dataset, lines, found: the trials and the search over their lines.
        final: error on held-out trials with all that was found.
        before, after: predictions without and with that.
    """
    trials = [trial for trial in dataset.trials if trial.kind == "cut"]
    known = all(trial.spindle_angle_rad is not None for trial in trials)
    if dataset.tool.kind in LEVEL_KINDS or not known:
        return None
    kind, teeth = effect_class(NAME), dataset.tool.teeth
    speed, sure = np.array([each.speed_rev_s for each in after]), tells_phase(dataset, lines, found)
    folds = [sure & (final.fold != fold) for fold in range(int(final.fold.max()) + 1)]
    if sure.sum() < _FEWEST or not all(_apart(speed[each]) for each in (sure, *folds)):
        return None
    measured = [spindle_angle(trial, each) for trial, each in zip(trials, speed, strict=True)]
    phases = Phases(_against(measured, after), speed, teeth)
    delay = phases.of(sure).delay(kind.parameters["delay_s"].high)
    without, rest = (phases.away(each, sure)[sure] for each in (0.0, delay))
    by_fold, one_zero, one_delay = [], np.zeros_like(speed), np.zeros_like(speed)
    for use in folds:
        held = sure & ~use
        by_fold.append(phases.of(use).closer(delay))
        one_zero[held] = phases.away(0.0, use)[held]
        one_delay[held] = phases.away(by_fold[-1], use)[held]

    def error(fit: Fit, old: HeldOut, shown: Sequence[Prediction], away: Array) -> HeldOut:
        """Held-out error with every trial turned back by what its phase is away."""
        sides = (_shown(dataset, lines, found, fit, turn) for turn in (0.0 * away, -away))
        added = old.error_n2.copy()
        for index, (here, there) in enumerate(zip(*sides, strict=True)):
            left = shown[index].residual_n
            more = there.predicted_n - here.predicted_n
            added[index] += np.sum((left - more) ** 2 - left**2, axis=0)
        return HeldOut(np.maximum(added, 0.0), old.energy_n2, old.fits, old.fold)

    rigid, late = (error(found.final_fit, final, after, away) for away in (one_zero, one_delay))
    p, error_s = _chance(phases.of(sure), without, rest, kind.parameters["delay_s"].high)
    told = {"delay_s": interval(kind, "delay_s", delay, np.array(by_fold), error_s)}
    decision = decide(kind, rigid, late, p, told, over_trials=False)
    silent = tuple(np.zeros((len(trial.time_s), 3)) for trial in trials)
    candidate = SlowCandidate(kind, kind(delay), late, decision, silent)
    tried = SlowRound(rigid, (candidate,), candidate if decision.accepted else None)
    bare = np.where(sure, Phases(_against(measured, before), speed, teeth).away(0.0, sure), 0.0)
    base = error(found.base_fit, found.base, before, bare)
    turned = _shown(dataset, lines, found, found.base_fit, -bare)
    return BeforeOthers(tried, base, turned, _evidence(without, rest, p))


def _shown(
    dataset: Dataset, lines: Lines, found: Search, fit: Fit, turn_rad: Array
) -> tuple[Prediction, ...]:
    bias = shared_bias(found.problem, fit.x)
    return predictions(dataset, lines, found.problem, fit.model, bias, turn_rad=turn_rad)


def _apart(speed_rev_s: Array) -> bool:
    """Whether speeds are there and differ by enough to tell a delay."""
    return bool(len(speed_rev_s)) and bool(speed_rev_s.max() >= _SPEEDS_APART * speed_rev_s.min())


def tells_phase(dataset: Dataset, lines: Lines, found: Search) -> NDArray[np.bool_]:
    """[R] whether a trial tells its phase but for whole teeth: not where no tooth passing is heard, or only
    every second or third harmonic of it, which a turn by half or a third of a tooth leaves alone."""
    pitch, nil = 2.0 * np.pi / dataset.tool.teeth, np.zeros(lines.trials)
    turns = (nil, nil + pitch / 2.0, nil + pitch / 3.0)
    still, *turned = (_shown(dataset, lines, found, found.final_fit, each) for each in turns)
    weights = np.asarray(found.problem.weights)
    changed = [
        [
            np.sum(((there.predicted_n - here.predicted_n) * weight) ** 2)
            for here, there, weight in zip(still, each, weights, strict=True)
        ]
        for each in turned
    ]
    return np.min(changed, axis=0) > _SURELY**2


def _against(measured: Sequence[Array], shown: Sequence[Prediction]) -> Array:
    """[R] angle of tooth 0 as fitted, less the measured one, rad."""
    return np.array([float(np.mean(p.angle_rad - angle)) for p, angle in zip(shown, measured, strict=True)])


@dataclass(frozen=True, eq=False)
class Phases:
    """Phases [R] of trials at their speeds [R], rad and rev/s, known but for whole teeth."""

    phase: Array
    speed: Array
    teeth: int

    def of(self, use: NDArray[np.bool_]) -> Phases:
        """Those of some of the trials."""
        return Phases(self.phase[use], self.speed[use], self.teeth)

    def away(self, delay_s: float, use: NDArray[np.bool_] | slice = slice(None)) -> Array:
        """[R] how far each is from the zero that those of `use` have in common after a delay, rad."""
        turned = np.exp(1j * self.teeth * (self.phase + 2.0 * np.pi * self.speed * delay_s))
        return np.asarray(np.angle(turned * np.conj(np.mean(turned[use]))) / self.teeth)

    def delay(self, longest_s: float) -> float:
        """The delay that brings the phases together; of several that do as well, since speeds in simple
        ratios let teeth pass unseen, the shortest."""
        step = 1.0 / (_STEPS_A_TOOTH * self.teeth * np.ptp(self.speed))
        steps = int(longest_s / step)
        delays = step * np.arange(-steps, steps + 1)
        left = self._left(delays)
        dips = np.flatnonzero((left <= np.roll(left, 1)) & (left <= np.roll(left, -1)))
        closer = np.array([self.closer(each) for each in delays[dips]])
        left = self._left(closer)
        good = closer[left <= _AS_GOOD * left.min() + len(self.phase) * _SURE_RAD**2]
        return float(good[np.argmin(np.abs(good))])

    def closer(self, delay_s: float) -> float:
        """The delay near one at which the phases lie closest together."""
        away = self.away(delay_s)
        more = self.speed - self.speed.mean()
        return delay_s - float(more @ away / (more @ more)) / (2.0 * np.pi)

    def _left(self, delays_s: Array) -> Array:
        return np.array([np.sum(self.away(float(each)) ** 2) for each in delays_s])


def _chance(phases: Phases, without: Array, rest: Array, longest_s: float) -> tuple[float, float]:
    """Probability that some delay brings phases that lie anywhere as much closer together (from `without` to
    `rest`, [R]), rad; and the standard error of the delay, s."""
    freedom = len(rest) - 2
    spread = max(float(rest @ rest) / freedom, _SURE_RAD**2)
    statistic = max(float(without @ without - rest @ rest), 0.0) / spread
    tries = 1.0 + 2.0 * longest_s * phases.teeth * float(np.ptp(phases.speed))
    more = phases.speed - phases.speed.mean()
    error_s = float(np.sqrt(spread / np.sum(more**2))) / (2.0 * np.pi)
    return min(1.0, tries * float(stats.f.sf(statistic, 1, freedom))), error_s


def _evidence(without: Array, rest: Array, p: float) -> tuple[str, ...]:
    apart, together = (np.degrees(np.sqrt(np.mean(each**2))) for each in (without, rest))
    return (
        f"the phase of the cut against the measured angle differs by {apart:.2g} deg from trial to trial, "
        f"and by {together:.2g} deg once the force is late by one time in all (p = {p:.1g} by chance)",
    )
