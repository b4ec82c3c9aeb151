"""Chatter of a tool that is always engaged (turning, drilling): one line that grows, and what goes with it.

Such a tool meets its own wave one turn (or lip) later. Its force has no lines of the spindle, so that a
vibration stands alone: near one frequency, a little above the mode's, in the wide cuts and not in the narrow
ones, and moved by the speed, since a whole number of waves and a part must fit on a turn (Tlusty and Ismail,
CIRP Annals 30 (1981) 299-304). How large it grows is the trial's own; so what is held out is every other
stretch of the record, over which its amplitude and phase are carried from those beside it.

Named when three trials hold such a line of three hundredths of the force or more, near one frequency, off the
spindle's multiples in most and off those of anything that comes back at a rate of its own (`own_rate`), which
strikes and drives a mode; when narrower cuts are free of it, or it moves with the speed by more than the
records resolve, though not in proportion to it; when it is not in air; and when the error of those trials,
on the stretches not fitted, falls by a tenth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing.along.own_rate import own_rate
from mjx_cutting.tracing.along.selfexcited import NAME, SelfExcited
from mjx_cutting.tracing.along.slow_round import SlowCandidate, SlowRound
from mjx_cutting.tracing.along.vibration import FAR_ABOVE, RESOLVED
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.naming.chance import gain_over_trials
from mjx_cutting.tracing.naming.decision import Decision
from mjx_cutting.tracing.naming.intervals import Interval
from mjx_cutting.trials.dataset import Dataset, Trial

_FEWEST = 3
_LEAST_SHARE = 0.03
_FREE = 0.2
_NEAR = 0.15
_BAND = 0.03
_NARROWER = 0.9
_LEAST_FALL = 0.1
_LOWEST_TURNS = 3.0
_SIDEBANDS = 2
_KNOTS = 13
_STRETCHES = 48
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class _Line:
    """The strongest line of a record. Fields: `frequency_hz`; `over_noise` its energy over that of the noise;
    `share` of the force that what lies near it is; `wave_n` [T, 3] it and what goes with it; `change_n2` [3]
    of the squared error on stretches that were not fitted to."""

    frequency_hz: float
    over_noise: float
    share: float
    wave_n: Array
    change_n2: Array

    @property
    def large(self) -> bool:
        """Whether it is of the size that ends its growth: that at which the tool leaves the chip."""
        return self.over_noise > FAR_ABOVE and self.share > _LEAST_SHARE


def find_chatter(
    dataset: Dataset, band_hz: tuple[float, float], after: Sequence[Prediction], before: HeldOut
) -> SelfExcited | None:
    """Chatter in what the levels leave; None where fewer than three trials show such a line, or none near the
    frequency in the middle of them.

    Arguments:
        after: predictions of the model with everything else in it.
        before: its error on held-out trials.
    """
    trials = [trial for trial in dataset.trials if trial.kind == "cut"]
    teeth = dataset.tool.teeth
    lines = [_line(each, trial, teeth, band_hz) for each, trial in zip(after, trials, strict=True)]
    large = np.array([each.large for each in lines])
    if large.sum() < _FEWEST:
        return None
    frequency = np.array([each.frequency_hz for each in lines])
    middle = float(np.median(frequency[large]))
    shown = large & (np.abs(frequency / middle - 1.0) < _NEAR)
    if not shown.any():
        return None
    error = before.error_n2.copy()
    for i in np.flatnonzero(shown):
        error[i] += lines[i].change_n2
    held_out = HeldOut(np.maximum(error, 0.0), before.energy_n2, before.fits, before.fold)
    reasons = _reasons(dataset, trials, after, lines, shown, (before, held_out))
    gain, spread = gain_over_trials(before, held_out)
    kind = effect_class(NAME)
    low, high = float(frequency[shown].min()), float(frequency[shown].max())
    # the line stands above the mode, where its response opposes the force: by 10 % at heavy damping
    told = {"frequency_hz": Interval(low, 0.9 * low, high, kind.parameters["frequency_hz"].unit)}
    decision = Decision(not reasons, True, 0.0, gain, spread, told, tuple(reasons))
    effect = kind(np.full(2, np.nan), np.full(2, low), np.full(2, np.nan))
    waves = tuple(
        line.wave_n if own else np.zeros_like(line.wave_n) for line, own in zip(lines, shown, strict=True)
    )
    candidate = SlowCandidate(kind, effect, held_out, decision, waves)
    tried = SlowRound(before, (candidate,), candidate if decision.accepted else None)
    return SelfExcited(tried, _evidence(trials, lines, shown))


def _line(each: Prediction, trial: Trial, teeth: int, band_hz: tuple[float, float]) -> _Line:
    """The strongest line of a record beside its level, above all that a few turns could show."""
    time, rest = each.time_s, each.residual_n - each.residual_n.mean(axis=0)
    rate_hz = (len(time) - 1) / time[-1]
    power = np.abs(np.fft.rfft(rest * np.hanning(len(time))[:, None], axis=0)) ** 2
    place = np.fft.rfftfreq(len(time), 1.0 / rate_hz)
    heard = (place > max(_LOWEST_TURNS * trial.spindle_speed_rev_s, band_hz[0])) & (place < band_hz[1])
    silent = _Line(0.0, 0.0, 0.0, np.zeros_like(rest), np.zeros(3))
    if heard.sum() < FAR_ABOVE:
        return silent
    noise = np.median(power[heard], axis=0)
    alive = noise > 0.0
    over = np.sum(power[:, alive] / noise[alive], axis=1) * heard
    frequency = float(place[int(np.argmax(over))])
    near = np.abs(place / frequency - 1.0) < _BAND
    held = np.sum((power - noise)[near & heard]) / max(float(np.sum(power)), 1e-300)
    force = np.sum((each.measured_n - each.bias_n) ** 2)
    share = float(np.sqrt(max(held, 0.0) * np.sum(rest**2) / force))
    line = _Line(frequency, float(over.max() / max(alive.sum(), 1)), share, silent.wave_n, silent.change_n2)
    if not line.large:
        return line
    tooth_hz = teeth * trial.spindle_speed_rev_s
    beside = [
        abs(whole * frequency + k * tooth_hz) for whole in (1, 2) for k in range(-_SIDEBANDS, _SIDEBANDS + 1)
    ]
    kept = [f for f in dict.fromkeys(beside) if RESOLVED / time[-1] < f < 0.5 * rate_hz]
    wave, change = _carried(time, rest, np.array(kept))
    return _Line(line.frequency_hz, line.over_noise, line.share, wave, change)


def _carried(time: Array, rest: Array, lines_hz: Array) -> tuple[Array, Array]:
    """[T, 3] lines with amplitudes straight between knots, fitted to all of a record; [3] change of its
    squared error where every other stretch is predicted from those beside it."""
    knots = np.linspace(0.0, time[-1], _KNOTS)
    hats = np.clip(1.0 - np.abs(time[:, None] - knots) / (knots[1] - knots[0]), 0.0, 1.0)
    turn = 2.0 * np.pi * np.multiply.outer(time, lines_hz)
    waves = np.concatenate([np.cos(turn), np.sin(turn)], axis=1)
    columns = (waves[:, :, None] * hats[:, None, :]).reshape(len(time), -1)
    stretch = np.floor(time / time[-1] * _STRETCHES * (1.0 - 1e-9)).astype(int) % 2
    change = np.zeros(3)
    for kept in (0, 1):
        own, other = stretch == kept, stretch != kept
        predicted = columns[other] @ _solved(columns[own], rest[own])
        change += np.sum((rest[other] - predicted) ** 2 - rest[other] ** 2, axis=0)
    return columns @ _solved(columns, rest), change


def _solved(x: Array, y: Array) -> Array:
    normal = x.T @ x
    small = 1e-3 * np.trace(normal) / len(normal)
    return np.linalg.solve(normal + small * np.eye(len(normal)), x.T @ y)


def _reasons(
    dataset: Dataset,
    trials: Sequence[Trial],
    after: Sequence[Prediction],
    lines: Sequence[_Line],
    shown: NDArray[np.bool_],
    errors: tuple[HeldOut, HeldOut],
) -> list[str]:
    """Why lines that stand out in several trials are given no name."""
    reasons = []
    if shown.sum() < max(_FEWEST, 0.6 * sum(each.large for each in lines)):
        reasons.append(f"lines stand out near one frequency in {shown.sum()} trials only")
        return reasons
    frequency = np.array([each.frequency_hz for each in lines])[shown]
    speed = np.array([each.spindle_speed_rev_s for each in trials])
    width = np.array([each.axial_width_m for each in trials])
    finest = RESOLVED / np.array([each.time_s[-1] for each in after])[shown]
    away = np.abs(frequency / speed[shown] - np.round(frequency / speed[shown])) * speed[shown]
    if np.mean(away > finest) < 0.5:
        reasons.append("the lines stand at multiples of the spindle's frequency: forced, not self-excited")
    strikes = own_rate(dataset, after)
    if strikes is not None and _multiples_of(strikes.lowest_hz[shown], frequency, finest):
        reasons.append(f"the lines are multiples of one that comes back {strikes}: driven, not self-excited")
    free = np.array([each.share < _FREE * _LEAST_SHARE for each in lines]) & ~shown
    threshold = bool(free.any() and width[free].max() < _NARROWER * width[shown].min())
    moved = np.ptp(frequency) > finest.max()
    order = np.ptp(frequency / speed[shown]) * speed[shown].mean() > finest.max()
    if not threshold and not (moved and order):
        stays = "goes with the speed in proportion" if moved else "stays whatever the speed"
        ends = f"{frequency.min():.2f} to {frequency.max():.2f} Hz"
        reasons.append(f"the line {stays} ({ends}), and no narrower cut is free of it")
    first, then = (each.only(shown).nrmse for each in errors)
    if then > (1.0 - _LEAST_FALL) * first:
        reasons.append(f"error on stretches of them not fitted goes from {first:.4f} to {then:.4f} only")
    for trial in dataset.trials:
        if trial.kind == "air" and _in_air(trial, frequency):
            reasons.append(f"{trial.file}: the line is in air too")
    return reasons


def _multiples_of(lowest_hz: Array, frequency: Array, finest: Array) -> bool:
    """Whether most of the lines [R] stand at multiples of the lowest of their trials [R], 0 where none is."""
    low = np.where(lowest_hz > 0.0, lowest_hz, np.inf)
    away = np.abs(frequency - low * np.round(frequency / low))
    return bool(np.mean((lowest_hz > 0.0) & (away < np.maximum(finest, _BAND * low))) > 0.5)


def _in_air(trial: Trial, frequency: Array) -> bool:
    """Whether a record without cutting has a line where the cuts vibrate."""
    time = trial.time_s - trial.time_s[0]
    left = trial.force_n - trial.force_n.mean(axis=0)
    power = np.sum(np.abs(np.fft.rfft(left * np.hanning(len(time))[:, None], axis=0)) ** 2, axis=1)
    place = np.fft.rfftfreq(len(time), time[-1] / (len(time) - 1))
    near = (place > (1.0 - _BAND) * frequency.min()) & (place < (1.0 + _BAND) * frequency.max())
    return bool(near.any() and power[near].max() > FAR_ABOVE * np.median(power))


def _evidence(trials: Sequence[Trial], lines: Sequence[_Line], shown: NDArray[np.bool_]) -> tuple[str, ...]:
    first = max((i for i, own in enumerate(shown) if own), key=lambda i: lines[i].share)
    line, trial = lines[first], trials[first]
    turns = line.frequency_hz / trial.spindle_speed_rev_s
    others = [(each, own) for each, own, is_shown in zip(trials, lines, shown, strict=True) if not is_shown]
    widest = max((each.axial_width_m for each, _ in others), default=0.0)
    quiet = max((own.share for _, own in others), default=0.0)
    return (
        f"{trial.file} vibrates at {line.frequency_hz:.1f} Hz, {turns:.2f} times the spindle's, by "
        f"{line.share:.0%} of its force; so do {shown.sum()} of {len(trials)}",
        f"those that do not are at most {1e3 * widest:.3g} mm wide and hold {quiet:.1%} at most"
        if others
        else "no trial is free of it: no threshold was seen",
        "amplitude and phase of such a line are its trial's own: carried over every other stretch of the "
        "record from those beside it; it does not tell the mode's stiffness and damping, so the model "
        "written does not hold it: a tap test on the tool gives them",
    )
