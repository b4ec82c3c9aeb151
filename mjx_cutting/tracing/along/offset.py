"""Time offset, named from the phases: by how much the force lags the measured angle at each speed.

A fit leaves the phase of every trial free, at which its teeth stand at the measured angle. That is the zero
of the encoder, the same in all trials; if the force is late by a time D, it goes with the speed f:

    phase = zero - 2 pi f D, known but for whole teeth

What names the offset is a delay that brings the phases of all trials together as chance would not. Held-out
error: "before" is scored with every trial at the zero that the others have in common, "after" where the
others' zero and delay put it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing.along.slow import SlowCandidate, SlowRound
from mjx_cutting.tracing.fitting.fit import Fit
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.prediction import Prediction, predictions
from mjx_cutting.tracing.fitting.problem import shared_bias
from mjx_cutting.tracing.naming.decision import decide, interval
from mjx_cutting.tracing.naming.search import Search
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import Lines
from mjx_cutting.tracing.records.spindle import spindle_angle
from mjx_cutting.trials.dataset import Dataset

NAME = "time_offset"
_FEWEST = 4
_SPEEDS_APART = 1.05
_STEPS_A_TOOTH = 32
_AS_GOOD = 2.0
_SURE_RAD = 1e-4
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Offset:
    """An offset tried: its round, the base model's error and predictions where all trials have one zero of
    the angle, and what speaks for it."""

    round: SlowRound
    base: HeldOut
    before: tuple[Prediction, ...]
    evidence: tuple[str, ...]


def find_offset(
    dataset: Dataset,
    lines: Lines,
    found: Search,
    final: HeldOut,
    before: Sequence[Prediction],
    after: Sequence[Prediction],
) -> Offset | None:
    """A delay of the force beside all else that was found (call it in float64); None where the trials cannot
    tell one.

    Arguments:
        dataset, lines, found: the trials and the search over their lines.
        final: error on held-out trials with all that was found.
        before, after: predictions without and with that.
    """
    trials = [trial for trial in dataset.trials if trial.kind == "cut"]
    known = all(trial.spindle_angle_rad is not None for trial in trials)
    speed = np.array([each.speed_rev_s for each in after])
    slowest = _SPEEDS_APART * speed.min()
    if dataset.tool.kind in LEVEL_KINDS or not known or len(trials) < _FEWEST or speed.max() < slowest:
        return None
    kind, teeth = effect_class(NAME), dataset.tool.teeth
    measured = [spindle_angle(trial, each) for trial, each in zip(trials, speed, strict=True)]

    def error(fit: Fit, old: HeldOut, shown: Sequence[Prediction], away: Array) -> HeldOut:
        """Held-out error with every trial turned back by what its phase is away."""
        sides = (_shown(dataset, lines, found, fit, turn) for turn in (0.0 * away, -away))
        added = old.error_n2.copy()
        for index, (here, there) in enumerate(zip(*sides, strict=True)):
            left = shown[index].residual_n
            more = there.predicted_n - here.predicted_n
            added[index] += np.sum((left - more) ** 2 - left**2, axis=0)
        return HeldOut(np.maximum(added, 0.0), old.energy_n2, old.fits, old.fold)

    own = _phases(measured, after)
    delay = _delay(own, speed, teeth, kind.parameters["delay_s"].high)
    without, rest = (_away(own, speed, teeth, each) for each in (0.0, delay))
    by_fold, one_zero, one_delay = [], np.empty_like(own), np.empty_like(own)
    for fold in range(int(final.fold.max()) + 1):
        use = final.fold != fold
        by_fold.append(_closer(own[use], speed[use], teeth, delay))
        for away, each in ((one_zero, 0.0), (one_delay, by_fold[-1])):
            away[~use] = _away(own, speed, teeth, each, use)[~use]
    fit = found.final_fit
    rigid, late = (error(fit, final, after, away) for away in (one_zero, one_delay))
    freedom = len(own) - 2
    spread = max(float(rest @ rest) / freedom, _SURE_RAD**2)
    statistic = max(float(without @ without - rest @ rest), 0.0) / spread
    tries = 1.0 + 2.0 * kind.parameters["delay_s"].high * teeth * float(np.ptp(speed))
    p = min(1.0, tries * float(stats.f.sf(statistic, 1, freedom)))
    error_s = float(np.sqrt(spread / np.sum((speed - speed.mean()) ** 2))) / (2.0 * np.pi)
    told = {"delay_s": interval(kind, "delay_s", delay, np.array(by_fold), error_s)}
    decision = decide(kind, rigid, late, p, told, over_trials=False)
    silent = tuple(np.zeros((len(trial.time_s), 3)) for trial in trials)
    candidate = SlowCandidate(kind, kind(delay), late, decision, silent)
    tried = SlowRound(rigid, (candidate,), candidate if decision.accepted else None)
    bare = _away(_phases(measured, before), speed, teeth, 0.0)
    base = error(found.base_fit, found.base, before, bare)
    return Offset(
        tried, base, _shown(dataset, lines, found, found.base_fit, -bare), _evidence(without, rest, p)
    )


def _shown(
    dataset: Dataset, lines: Lines, found: Search, fit: Fit, turn_rad: Array
) -> tuple[Prediction, ...]:
    bias = shared_bias(found.problem, fit.x)
    return predictions(dataset, lines, found.problem, fit.model, bias, turn_rad=turn_rad)


def _phases(measured: Sequence[Array], shown: Sequence[Prediction]) -> Array:
    """[R] angle of tooth 0 as fitted, less the measured one, rad."""
    return np.array([float(np.mean(p.angle_rad - angle)) for p, angle in zip(shown, measured, strict=True)])


def _away(phase: Array, speed: Array, teeth: int, delay_s: float, use: Array | None = None) -> Array:
    """[R] how far each phase is from the zero that those of `use` have in common after a delay, rad, but for
    whole teeth."""
    turned = np.exp(1j * teeth * (phase + 2.0 * np.pi * speed * delay_s))
    zero = np.mean(turned if use is None else turned[use])
    return np.asarray(np.angle(turned * np.conj(zero)) / teeth)


def _delay(phase: Array, speed: Array, teeth: int, longest_s: float) -> float:
    """The delay that brings the phases together; of several that do as well, since speeds in simple ratios
    let teeth pass unseen, the shortest."""
    step = 1.0 / (_STEPS_A_TOOTH * teeth * np.ptp(speed))
    steps = int(longest_s / step)
    delays = step * np.arange(-steps, steps + 1)
    left = np.array([np.sum(_away(phase, speed, teeth, each) ** 2) for each in delays])
    dips = np.flatnonzero((left <= np.roll(left, 1)) & (left <= np.roll(left, -1)))
    closer = np.array([_closer(phase, speed, teeth, each) for each in delays[dips]])
    left = np.array([np.sum(_away(phase, speed, teeth, each) ** 2) for each in closer])
    good = closer[left <= _AS_GOOD * left.min() + len(phase) * _SURE_RAD**2]
    return float(good[np.argmin(np.abs(good))])


def _closer(phase: Array, speed: Array, teeth: int, delay_s: float) -> float:
    """The delay near one at which the phases lie closest together."""
    away = _away(phase, speed, teeth, delay_s)
    more = speed - speed.mean()
    return delay_s - float(more @ away / (more @ more)) / (2.0 * np.pi)


def _evidence(without: Array, rest: Array, p: float) -> tuple[str, ...]:
    apart, together = (np.degrees(np.sqrt(np.mean(each**2))) for each in (without, rest))
    return (
        f"the phase of the cut against the measured angle differs by {apart:.2g} deg from trial to trial, "
        f"and by {together:.2g} deg once the force is late by one time in all (p = {p:.1g} by chance)",
    )
