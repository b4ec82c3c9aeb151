"""Self-excited vibration: lines at f_c + k f_t with f_c no multiple of the spindle frequency.

Such a line belongs to no line of the spindle and starts every trial at a phase of its own, with the size
that its limit cycle takes there. What other trials can say of a trial is therefore not the wave but the
pattern: that it vibrates near the same frequency, off the spindle's multiples, with sidebands one tooth
passing apart (Insperger and others, Int. J. Machine Tools and Manufacture 43 (2003) 25-40). The pattern is
looked for in every trial by itself (`vibration`).

Named when, in at least three trials (in two, if it is a tenth of the force in both, and another trial at the
speed of one of them is quiet, as none is of a gear or belt), at least two lines of one pattern stand far
above the noise, one of the strongest near one frequency in all of them, not the same in most of the trials to
the resolution of the records although the speeds differ (a line of the mains stays put), nor the same part of
the spindle's (what a gear or belt does turns with it), further from tooth passing than a slow change of the
force puts its sidebands, and not where a known wave of the sheet puts them, of three hundredths of the force
or more (what ends its growth is that teeth leave the chip), and none of it in air; and when the error of
those trials, on the stretches not fitted, falls by a tenth.
Where trials at a flip lobe show half of tooth passing among the spindle's own orders (`flip`), those count as
well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing.along.flip import Flip, flipping
from mjx_cutting.tracing.along.slow_round import SlowCandidate, SlowRound
from mjx_cutting.tracing.along.vibration import FAR_ABOVE, RESOLVED, Vibration, vibration
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.naming.chance import gain_over_trials
from mjx_cutting.tracing.naming.decision import Decision
from mjx_cutting.tracing.naming.intervals import Interval
from mjx_cutting.tracing.records.comb import SPREAD
from mjx_cutting.tracing.records.lines import Lines
from mjx_cutting.trials.dataset import Dataset

NAME = "regenerative_chatter"
_FEWEST = 3
_LARGE_IN_TWO = 0.1
_SPREAD = 0.15
_NEARLY_AS_STRONG = 0.5
_MOST_ALIKE = 0.6
_LEAST_FALL = 0.1
_LEAST_SHARE = 0.03
_SIDEBANDS_OF_A_WAVE = 3
_SAME_ORDER = 0.5
_FLIPS_ABOVE = 0.7
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class SelfExcited:
    """The vibration of a session: its round beside the other effects, and what speaks for it."""

    round: SlowRound
    evidence: tuple[str, ...]


def find_vibration(
    dataset: Dataset,
    lines: Lines,
    after: Sequence[Prediction],
    before: HeldOut,
    weight: Array,
    waves_hz: Array | None = None,
) -> SelfExcited | None:
    """Self-excited vibration in what the final model leaves; None where too few trials show it.

    Arguments:
        after: predictions of the model with everything else in it.
        before: its error on held-out trials.
        weight: [3] 1 / standard deviation of each axis.
        waves_hz: [R, W] frequency at which each trial passes the waves of the sheet that are in the model.
    """
    waves_hz = np.zeros((len(after), 0)) if waves_hz is None else waves_hz
    found = _off_the_orders(dataset, lines, after, before, weight, waves_hz)
    flips = flipping(dataset, after, lines.orders)
    return _with_flips(found, flips, dataset, after, before) if flips else found


def _off_the_orders(
    dataset: Dataset,
    lines: Lines,
    after: Sequence[Prediction],
    before: HeldOut,
    weight: Array,
    waves_hz: Array,
) -> SelfExcited | None:
    """Vibration at lines that are no multiple of the spindle's."""
    teeth = dataset.tool.teeth
    each = [vibration(trial, trial.residual_n, lines, teeth, weight) for trial in after]
    shown = [
        i
        for i, (v, trial, waves) in enumerate(zip(each, after, waves_hz, strict=True))
        if v.found and _large(v, trial) and _own(v, trial, teeth, waves)
    ]
    if not _enough(shown, each, after):
        return None
    frequency, alike = _common([each[i] for i in shown])
    shown, frequency = [i for i, near in zip(shown, alike, strict=True) if near], frequency[alike]
    for i, own in zip(shown, frequency, strict=True):
        each[i] = replace(each[i], frequency_hz=float(own))
    error = before.error_n2.copy()
    for i in shown:
        error[i] += each[i].error_change_n2
    held_out = HeldOut(np.maximum(error, 0.0), before.energy_n2, before.fits, before.fold)
    reasons = []
    if not _enough(shown, each, after) or np.mean(alike) < _MOST_ALIKE:
        reasons.append(
            f"the lines off the spindle's multiples stand near one frequency in {len(shown)} trials of "
            f"{len(alike)} that show any"
        )
    reasons += _reasons(dataset, after, shown, frequency, before, held_out)
    order = _shared_order(each, after, shown, teeth)
    if order is not None:
        reasons.append(
            f"the lines stand {order:.3f} times the spindle's frequency beside tooth passing at every speed: "
            "something that turns with it (a gear, a belt), not self-excited"
        )
    gain, spread = gain_over_trials(before, held_out)
    unit = effect_class(NAME).parameters["frequency_hz"].unit
    # the lines stand above the mode, where its response opposes the force: by 10 % at heavy damping
    low, high = float(frequency.min()), float(frequency.max())
    told = {"frequency_hz": Interval(low, 0.9 * low, high, unit)}
    by_chance = float(stats.binom.sf(len(shown) - 1, len(after), _false_alarm(lines, after)))
    decision = Decision(not reasons, True, by_chance, gain, spread, told, tuple(reasons))
    kind = effect_class(NAME)
    effect = kind(np.full(2, np.nan), np.full(2, low), np.full(2, np.nan))
    waves = tuple(v.wave_n if i in shown else np.zeros_like(v.wave_n) for i, v in enumerate(each))
    candidate = SlowCandidate(kind, effect, held_out, decision, waves)
    tried = SlowRound(before, (candidate,), candidate if decision.accepted else None)
    return SelfExcited(tried, _evidence(after, each, shown, teeth))


def _with_flips(
    found: SelfExcited | None,
    flips: dict[int, Flip],
    dataset: Dataset,
    after: Sequence[Prediction],
    before: HeldOut,
) -> SelfExcited | None:
    """The same with the trials at a flip lobe, which are named by themselves where nothing else was."""
    accepted = found.round.accepted if found is not None else None
    waves = [np.zeros_like(each.measured_n) for each in after]
    error = before.error_n2.copy()
    if accepted is not None:
        waves, error = list(accepted.added_n), accepted.heldout.error_n2.copy()
    for i, flip in flips.items():
        waves[i] = waves[i] + flip.wave_n
        error[i] += flip.error_change_n2
    held_out = HeldOut(np.maximum(error, 0.0), before.energy_n2, before.fits, before.fold)
    gain, spread = gain_over_trials(before, held_out)
    frequency = np.array([flip.frequency_hz for flip in flips.values()])
    kind = effect_class(NAME)
    if accepted is not None:
        decision = replace(accepted.decision, gain=gain, gain_standard_error=spread)
    else:
        reasons = _reasons(dataset, after, sorted(flips), frequency, before, held_out)
        low, high = float(frequency.min()), float(frequency.max())
        told = {"frequency_hz": Interval(low, _FLIPS_ABOVE * low, high, kind.parameters["frequency_hz"].unit)}
        decision = Decision(not reasons, True, 0.0, gain, spread, told, tuple(reasons))
    if not decision.accepted:
        return found
    effect = kind(
        np.full(2, np.nan), np.full(2, decision.parameters["frequency_hz"].value), np.full(2, np.nan)
    )
    candidate = SlowCandidate(kind, effect, held_out, decision, tuple(waves))
    return SelfExcited(
        SlowRound(before, (candidate,), candidate),
        (
            *(found.evidence if accepted is not None and found is not None else ()),
            *_flip_evidence(flips, after),
        ),
    )


def _flip_evidence(flips: dict[int, Flip], after: Sequence[Prediction]) -> tuple[str, ...]:
    most = max(flips.values(), key=lambda each: each.share)
    files = ", ".join(each.file for each in flips.values())
    return (
        f"{most.file} has a line at {most.frequency_hz:.1f} Hz, half of tooth passing, {most.share:.0%} of "
        "the force, and next to nothing at the spindle's other orders: every second tooth cuts deep; so in "
        f"{len(flips)} of {len(after)} trials ({files}); it is gone in others at the same speed, as no "
        "difference between the teeth is: a flip lobe",
        "the mode stands below that line, by little where it is lightly damped; amplitude and phase are the "
        "trial's own, so the model written does not hold it: a tap test gives stiffness and damping",
    )


def _common(found: Sequence[Vibration]) -> tuple[Array, NDArray[np.bool_]]:
    """[R] line of each trial nearest the frequency that most of them share, and whether it is near that.

    Which line of a pattern is the strongest changes with the speed, so any that comes near it counts.
    """
    strong = [v.lines_hz[v.over_noise >= _NEARLY_AS_STRONG * v.over_noise[0]] for v in found]

    def nearest(middle: float) -> Array:
        return np.array([lines[np.argmin(np.abs(lines - middle))] for lines in strong])

    def apart(middle: float) -> Array:
        return np.asarray(np.abs(nearest(middle) / middle - 1.0))

    def few_and_far(middle: float) -> tuple[int, float]:
        away = apart(middle)
        return -int(np.sum(away < _SPREAD)), float(away[away < _SPREAD].mean())

    middle = float(min(np.concatenate(strong), key=few_and_far))
    return nearest(middle), apart(middle) < _SPREAD


def _shared_order(
    each: Sequence[Vibration], after: Sequence[Prediction], shown: Sequence[int], teeth: int
) -> float | None:
    """How many times the spindle's frequency a strong line of every trial `shown` stands beside a multiple of
    tooth passing, where that is the same although the speeds differ; else None. Where those shown ran at one
    speed, most of the others that ran at another and have lines too, however small, must have that one."""
    if not shown:
        return None
    speed = np.array([trial.speed_rev_s for trial in after])
    finest = _SAME_ORDER / (speed * [trial.time_s[-1] for trial in after])
    beside = {i: _beside_passing(v, speed[i], teeth) for i, v in enumerate(each) if len(v.lines_hz)}
    first, their = shown[0], speed[list(shown)]
    apart = SPREAD * their.mean()
    others = [i for i in beside if np.min(np.abs(speed[i] - their)) > apart]
    for order in beside[first]:
        same = {i: np.min(np.abs(own - order)) < finest[i] + finest[first] for i, own in beside.items()}
        at_other_speeds = np.ptp(their) > apart or sum(same[i] for i in others) > 0.5 * len(others)
        if at_other_speeds and all(same[i] for i in shown):
            return float(order)
    return None


def _beside_passing(v: Vibration, speed_rev_s: float, teeth: int) -> Array:
    """How many times the spindle's frequency the strong lines stand beside a multiple of tooth passing."""
    orders = v.lines_hz[v.over_noise >= _NEARLY_AS_STRONG * v.over_noise.max()] / speed_rev_s
    return np.abs(orders - teeth * np.round(orders / teeth))


def _false_alarm(lines: Lines, after: Sequence[Prediction]) -> float:
    """Probability that noise alone, of three axes, puts any line of a record that far above its median."""
    independent = max(float(trial.time_s[-1]) for trial in after) * (lines.band_hz[1] - lines.band_hz[0])
    return min(1.0, independent * float(stats.gamma.sf(FAR_ABOVE * stats.gamma.median(3.0), 3.0)))


def _large(found: Vibration, trial: Prediction, share: float = _LEAST_SHARE) -> bool:
    """Whether the vibration is of the size that ends it: that at which teeth leave the chip."""
    force = np.sum((trial.measured_n - trial.bias_n) ** 2)
    return bool(np.sum(found.wave_n**2) > share**2 * force)


def _enough(shown: Sequence[int], each: Sequence[Vibration], after: Sequence[Prediction]) -> bool:
    """Whether the trials `shown` to vibrate are enough to speak of the session."""
    if len(shown) != _FEWEST - 1:
        return len(shown) >= _FEWEST
    speeds = np.array([trial.speed_rev_s for trial in after])
    quiet = [i for i, (v, trial) in enumerate(zip(each, after, strict=True)) if not _large(v, trial)]
    beside = any(np.any(np.abs(speeds[quiet] / speeds[i] - 1.0) < 2.0 * SPREAD) for i in shown)
    return beside and all(_large(each[i], after[i], _LARGE_IN_TWO) for i in shown)


def _own(v: Vibration, trial: Prediction, teeth: int, waves_hz: Array) -> bool:
    """Whether the strongest line is neither tooth passing at a speed read wrongly, nor a slow change of it,
    nor one of the sidebands that waves of the sheet put beside it (one that the spindle gives way to has
    others than the model says)."""
    tooth_hz = teeth * trial.speed_rev_s
    whole = round(v.frequency_hz / tooth_hz)
    away = abs(v.frequency_hz - whole * tooth_hz)
    slowest = effect_class(NAME).parameters["frequency_hz"].low
    sidebands = np.multiply.outer(np.arange(1, _SIDEBANDS_OF_A_WAVE + 1), waves_hz)
    beside_one = np.any(np.abs(sidebands - away) < RESOLVED / trial.time_s[-1])
    return bool(away > max(slowest, SPREAD * whole * tooth_hz) and not beside_one)


def _reasons(
    dataset: Dataset,
    after: Sequence[Prediction],
    shown: list[int],
    frequency: Array,
    before: HeldOut,
    held_out: HeldOut,
) -> list[str]:
    """Why a pattern that enough trials share is given no name."""
    reasons = []
    speeds = np.array([after[i].speed_rev_s for i in shown])
    resolution = 1.0 / min(after[i].time_s[-1] for i in shown) if shown else 0.0
    most = 2 * len(shown) > len(after)
    if most and np.ptp(speeds) > SPREAD * speeds.mean() and np.ptp(frequency) < resolution:
        reasons.append(f"the line stays at {frequency.mean():.2f} Hz whatever the speed: not self-excited")
    them = np.isin(np.arange(len(after)), shown)
    first, then = (each.only(them).nrmse if shown else each.nrmse for each in (before, held_out))
    if then > (1.0 - _LEAST_FALL) * first:
        reasons.append(f"error on stretches of them not fitted goes from {first:.4f} to {then:.4f} only")
    for trial in dataset.trials:
        if trial.kind == "air" and shown and _in_air(trial.force_n, trial.time_s, frequency):
            reasons.append(f"{trial.file}: the lines are in air too")
    return reasons


def _in_air(force_n: Array, time: Array, frequency: Array) -> bool:
    """Whether a record without cutting has a line where the cuts vibrate."""
    rate_hz = (len(time) - 1) / (time[-1] - time[0])
    spectrum = np.sum(np.abs(np.fft.rfft((force_n - force_n.mean(axis=0)), axis=0)) ** 2, axis=1)
    place = np.fft.rfftfreq(len(time), 1.0 / rate_hz)
    near = (place > frequency.min() * (1.0 - SPREAD)) & (place < frequency.max() * (1.0 + SPREAD))
    return bool(near.any() and spectrum[near].max() > FAR_ABOVE * np.median(spectrum))


def _evidence(
    after: Sequence[Prediction], each: Sequence[Vibration], shown: list[int], teeth: int
) -> tuple[str, ...]:
    first = max(shown, key=lambda i: each[i].over_noise[0])
    v, trial = each[first], after[first]
    quiet = [trial.file for i, trial in enumerate(after) if i not in shown]
    others = v.lines_hz[np.abs(v.lines_hz - v.frequency_hz) > 1e-6]
    beside = ", ".join(f"{line:.1f}" for line in others[:3])
    speeds = f"{v.frequency_hz / trial.speed_rev_s:.2f} times the spindle's"
    return (
        f"{trial.file} vibrates at {v.frequency_hz:.1f} Hz, {speeds}, with lines at {beside} Hz beside it, "
        f"{teeth * trial.speed_rev_s:.1f} Hz of tooth passing apart; so do {len(shown)} of {len(after)}",
        f"trials that do not: {', '.join(quiet)}"
        if quiet
        else "no trial is free of it: no threshold was seen",
        "amplitude and phase of such a line are its trial's own: fitted on every other stretch of the "
        "record, scored on those between; its lines do not tell the mode's stiffness and damping, so the "
        "model written does not hold it: a tap test on the tool gives them",
    )
