"""Self-excited vibration: lines at f_c + k f_t with f_c no multiple of the spindle frequency.

Such a line belongs to no line of the spindle and starts every trial at a phase of its own, with the size
that its limit cycle takes there. What other trials can say of a trial is therefore not the wave but the
pattern: that it vibrates near the same frequency, off the spindle's multiples, with sidebands one tooth
passing apart (Insperger and others, Int. J. Machine Tools and Manufacture 43 (2003) 25-40). The pattern is
looked for in every trial by itself, in what is left beside all spindle orders. Its amplitudes are fitted on
every other stretch of the record and scored on those between, so that noise, and a gain that wanders, gain
nothing.

Named when, in at least three trials, at least two lines of one pattern stand far above the noise, one of the
strongest near one frequency in all of them, not the same to the resolution of the records although the
speeds differ (a line of the mains stays put), further from tooth passing than a slow change of the force
puts its sidebands, and not where a known wave of the sheet puts them, of three hundredths of the force or
more (what ends its growth is that teeth leave the chip), and none of it in air; and when the error on the
stretches not fitted falls by a tenth.
A flip lobe of a tool with an even number of teeth is hidden in the spindle's own orders and is not found
here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing.along.slow import SlowCandidate, SlowRound
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.naming.decision import Decision, Interval, gain_over_trials
from mjx_cutting.tracing.records.lines import Lines, basis
from mjx_cutting.tracing.records.spindle import SPREAD
from mjx_cutting.trials.dataset import Dataset

NAME = "regenerative_chatter"
_PAD = 4
_RESOLVED = 2.0
_STRETCHES = 16
_FAR_ABOVE = 30.0
_SIDEBAND = 12.0
_FEWEST = 3
_SPREAD = 0.15
_NEARLY_AS_STRONG = 0.5
_MOST_ALIKE = 0.6
_LEAST_FALL = 0.1
_LEAST_SHARE = 0.03
_MOST_LINES = 16
_SIDEBANDS_OF_A_WAVE = 3
_SHIFTS = 13
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Vibration:
    """The best pattern in one trial.

    Fields:
        frequency_hz: its strongest line, or one nearly as strong that other trials share.
        lines_hz: [L] its lines that stand above the noise, the strongest first.
        over_noise: [L] their energy over that of the noise.
        wave_n: [T, 3] the pattern fitted to the whole record.
        error_change_n2: [3] change of the squared error on stretches that were not fitted to.
    """

    frequency_hz: float
    lines_hz: Array
    over_noise: Array
    wave_n: Array
    error_change_n2: Array

    @property
    def found(self) -> bool:
        """True for two lines far above the noise that hold on stretches not fitted to."""
        strong = len(self.over_noise) > 1 and self.over_noise[0] > _FAR_ABOVE
        return bool(strong and self.error_change_n2.sum() < 0.0)


def vibration(trial: Prediction, left_n: Array, lines: Lines, teeth: int, weight: Array) -> Vibration:
    """The pattern of lines f_c + k f_t that holds most of what the spindle's orders leave.

    Arguments: trial: its times, angle and speed; left_n [T, 3] the residual looked at; weight [3] 1 / noise.
    """
    time, tooth_hz = trial.time_s, teeth * trial.speed_rev_s
    columns = basis(trial.angle_rad, lines.orders)
    rest = (left_n - columns @ _solved(columns, left_n)) * weight
    rate_hz = (len(time) - 1) / time[-1]
    window = np.hanning(len(time))
    length = int(2 ** np.ceil(np.log2(_PAD * len(time))))
    spectrum = np.sum(np.abs(np.fft.rfft(rest * window[:, None], n=length, axis=0)) ** 2, axis=1)
    frequency = np.fft.rfftfreq(length, 1.0 / rate_hz)
    band = (frequency >= max(lines.band_hz[0], _RESOLVED / time[-1])) & (frequency <= lines.band_hz[1])
    noise = float(np.median(spectrum[band]))
    over = np.where(band, spectrum, 0.0) / max(noise, 1e-300)
    top = 0.5 * rate_hz
    strongest = float(frequency[int(np.argmax(over))])
    steps = np.arange(-int(lines.band_hz[1] / tooth_hz) - 2, int(lines.band_hz[1] / tooth_hz) + 3)
    pattern = np.abs(strongest + steps * tooth_hz)
    found, energy = [], []
    for line in pattern[pattern < top]:
        near = np.abs(frequency - line) <= 1.0 / time[-1]
        size = float(over[near].max()) if near.any() else 0.0
        if size > (_FAR_ABOVE if abs(line - strongest) < 1e-9 else _SIDEBAND):
            found.append(float(line))
            energy.append(size)
    order: list[int] = []
    for index in np.argsort(energy)[::-1]:
        # two lines of the pattern that fold onto one place are one
        if all(abs(found[index] - found[other]) > _RESOLVED / time[-1] for other in order):
            order.append(int(index))
    order = order[:_MOST_LINES]
    chosen, over_noise = np.array([found[i] for i in order]), np.array([energy[i] for i in order])
    return _fitted(time, rest / weight, chosen, over_noise, strongest, tooth_hz)


def _fitted(
    time: Array, rest: Array, chosen: Array, over: Array, strongest: float, tooth_hz: float
) -> Vibration:
    """The lines chosen, their common frequency refined, fitted to the whole and to every other stretch."""
    if len(chosen) < 2:
        return Vibration(strongest, chosen, over, np.zeros_like(rest), np.zeros(3))
    stretch = np.floor(time / time[-1] * _STRETCHES * (1.0 - 1e-9)).astype(int) % 2

    def columns(shift: float) -> Array:
        # all lines move together: those folded through zero the other way
        step = np.where(_mirrored(chosen, strongest, tooth_hz), -shift, shift)
        turn = 2.0 * np.pi * np.multiply.outer(time, chosen + step)
        return np.concatenate([np.cos(turn), np.sin(turn)], axis=1)

    def fit(part: NDArray[np.bool_]) -> tuple[Array, Array]:
        def left(shift: float) -> float:
            x = columns(shift)[part]
            return float(np.sum((rest[part] - x @ _solved(x, rest[part])) ** 2))

        best, reach = 0.0, 0.5 / time[-1]
        for _ in range(2):
            shifts = best + reach * np.linspace(-1.0, 1.0, _SHIFTS)
            best = float(shifts[int(np.argmin([left(shift) for shift in shifts]))])
            reach /= 0.5 * (_SHIFTS - 1)
        x = columns(best)
        return x, _solved(x[part], rest[part])

    change = np.zeros(3)
    for kept in (0, 1):
        x, weights = fit(stretch == kept)
        other = stretch != kept
        change += np.sum((rest[other] - (x @ weights)[other]) ** 2, axis=0)
        change -= np.sum(rest[other] ** 2, axis=0)
    x, weights = fit(np.ones(len(time), bool))
    return Vibration(strongest, chosen, over, x @ weights, change)


def _solved(x: Array, y: Array) -> Array:
    """Least-squares weights by normal equations; what the columns cannot tell apart is kept small."""
    normal = x.T @ x
    return np.linalg.solve(normal + 1e-9 * np.trace(normal) / len(normal) * np.eye(len(normal)), x.T @ y)


def _mirrored(chosen: Array, strongest: float, tooth_hz: float) -> NDArray[np.bool_]:
    """[L] True for lines at k f_t - f_c, which fall when f_c rises."""
    turns = (chosen - strongest) / tooth_hz
    return np.abs(turns - np.round(turns)) > 1e-6


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
    """Self-excited vibration in what the final model leaves; None where too few trials show a pattern.

    Arguments:
        after: predictions of the model with everything else in it.
        before: its error on held-out trials.
        weight: [3] 1 / standard deviation of each axis.
        waves_hz: [R, W] frequency at which each trial passes the waves of the sheet that are in the model.
    """
    waves_hz = np.zeros((len(after), 0)) if waves_hz is None else waves_hz
    teeth = dataset.tool.teeth
    each = [vibration(trial, trial.residual_n, lines, teeth, weight) for trial in after]
    shown = [
        i
        for i, (v, trial, waves) in enumerate(zip(each, after, waves_hz, strict=True))
        if v.found and _large(v, trial) and _own(v, trial, teeth, waves)
    ]
    if len(shown) < _FEWEST:
        return None
    frequency, alike = _common([each[i] for i in shown])
    shown, frequency = [i for i, near in zip(shown, alike, strict=True) if near], frequency[alike]
    for i, own in zip(shown, frequency, strict=True):
        each[i] = replace(each[i], frequency_hz=float(own))
    error = before.error_n2.copy()
    for i in shown:
        error[i] += each[i].error_change_n2
    held_out = HeldOut(np.maximum(error, 0.0), before.energy_n2, before.fits, before.fold)
    reasons = _reasons(dataset, after, shown, frequency, alike, before, held_out)
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


def _false_alarm(lines: Lines, after: Sequence[Prediction]) -> float:
    """Probability that noise alone, of three axes, puts any line of a record that far above its median."""
    independent = max(float(trial.time_s[-1]) for trial in after) * (lines.band_hz[1] - lines.band_hz[0])
    return min(1.0, independent * float(stats.gamma.sf(_FAR_ABOVE * stats.gamma.median(3.0), 3.0)))


def _large(found: Vibration, trial: Prediction) -> bool:
    """Whether the vibration is of the size that ends it: that at which teeth leave the chip."""
    force = np.sum((trial.measured_n - trial.bias_n) ** 2)
    return bool(np.sum(found.wave_n**2) > _LEAST_SHARE**2 * force)


def _own(v: Vibration, trial: Prediction, teeth: int, waves_hz: Array) -> bool:
    """Whether the strongest line is neither tooth passing at a speed read wrongly, nor a slow change of it,
    nor one of the sidebands that waves of the sheet put beside it (one that the spindle gives way to has
    others than the model says)."""
    tooth_hz = teeth * trial.speed_rev_s
    whole = round(v.frequency_hz / tooth_hz)
    away = abs(v.frequency_hz - whole * tooth_hz)
    slowest = effect_class(NAME).parameters["frequency_hz"].low
    sidebands = np.multiply.outer(np.arange(1, _SIDEBANDS_OF_A_WAVE + 1), waves_hz)
    beside_one = np.any(np.abs(sidebands - away) < _RESOLVED / trial.time_s[-1])
    return bool(away > max(slowest, SPREAD * whole * tooth_hz) and not beside_one)


def _reasons(
    dataset: Dataset,
    after: Sequence[Prediction],
    shown: list[int],
    frequency: Array,
    alike: NDArray[np.bool_],
    before: HeldOut,
    held_out: HeldOut,
) -> list[str]:
    """Why the pattern is given no name."""
    reasons = []
    if len(shown) < _FEWEST or np.mean(alike) < _MOST_ALIKE:
        reasons.append(
            f"the lines off the spindle's multiples stand near one frequency in {len(shown)} trials of "
            f"{len(alike)} that show any"
        )
    speeds = np.array([after[i].speed_rev_s for i in shown])
    resolution = 1.0 / min(after[i].time_s[-1] for i in shown) if shown else 0.0
    if shown and np.ptp(speeds) > SPREAD * speeds.mean() and np.ptp(frequency) < resolution:
        reasons.append(f"the line stays at {frequency.mean():.2f} Hz whatever the speed: not self-excited")
    if held_out.nrmse > (1.0 - _LEAST_FALL) * before.nrmse:
        reasons.append(
            f"error on stretches not fitted goes from {before.nrmse:.4f} to {held_out.nrmse:.4f} only"
        )
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
    return bool(near.any() and spectrum[near].max() > _FAR_ABOVE * np.median(spectrum))


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
