"""When an effect may be named: tests that a candidate must pass, each with its figure.

1. chance: the drop in the weighted squared error, as an F test with as many tries as there are candidates
   and starts (Bonferroni). A coherent model error of `TOLERANCE` of the force counts as noise, because no
   simulator's own discretisation is finer and a chi-square alone names an effect in clean data.
2. held out: the error on unseen trials falls by at least `LEAST_GAIN` of itself, by `TOLERANCE` of the force
   (root mean square; less where the model's force hardly is) and by two standard errors over trials (of
   fewer than five by as many as a t of their freedom asks), or in shares of what each trial leaves by more
   than chance does; and no axis pays for it.
3. interval: the strength's interval excludes the value at which the effect vanishes, and a resonance is known
   to an octave.
4. range: every parameter lies inside its physical range, not at the edge of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.cutting.effects import Parameter
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.problem import TOLERANCE

CHANCE = 0.01
LEAST_GAIN = 0.02
STANDARD_ERRORS = 2.0
CONFIDENCE = 0.95
_EDGE = 0.01
_BENEATH = 0.1
_UNMOVED = 1e-6
_NIL = 1e-9
_MOST_WIDENED = 3.0
_WIDEST = 50.0
_RISES = 0.25
_MOST_TRIALS = 0.75
_SHARP = 2.0
_FEW_TRIALS = 5
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Interval:
    """A parameter with its interval, in `unit`; of several values (teeth, axes) the surest, all in `values`
    with `half`, half the width of each interval."""

    value: float
    low: float
    high: float
    unit: str
    values: tuple[float, ...] = ()
    half: tuple[float, ...] = ()


@dataclass(frozen=True)
class Decision:
    """Whether a candidate is accepted; `reasons` says why not, one entry a failed test.

    `physical` is False where it explains what it does only with a parameter at the edge of its range;
    `untold` is True where all that failed is what would tell it from another effect, or that a frequency is
    not known to a factor of two, `scattered` where it is that the gain differs much from trial to trial,
    `unsure` where it is that or chance; `guarded` where it passed every test and a guard refused it.
    """

    accepted: bool
    physical: bool
    p_chance: float
    gain: float
    gain_standard_error: float
    parameters: dict[str, Interval]
    reasons: tuple[str, ...]
    untold: bool = False
    scattered: bool = False
    unsure: bool = False
    guarded: bool = False


def chance(drop: float, added: int, spread: float, floor: float, freedom: int, tries: int) -> float:
    """Probability that the best of `tries` useless candidates lowers the squared error by `drop`.

    Arguments:
        drop: fall of the sum of squared weighted residuals.
        added: unknowns the candidate adds.
        spread: residual standard deviation per degree of freedom with the candidate in.
        floor: least standard deviation believed, from the tolerated model error.
        freedom: degrees of freedom left.
        tries: candidates times starts.
    """
    variance = max(spread, floor) ** 2
    statistic = max(drop, 0.0) / max(added, 1) / max(variance, 1e-300)
    return float(min(1.0, tries * stats.f.sf(statistic, max(added, 1), max(freedom, 1))))


def gain_over_trials(before: HeldOut, after: HeldOut) -> tuple[float, float]:
    """Fall of the heldout NRMSE and its standard error, by a jackknife over trials."""
    gain = before.nrmse - after.nrmse
    count = len(before.energy_n2)
    if count < 3:
        return gain, float("nan")
    total = before.energy_n2.sum()
    parts = []
    for trial in range(count):
        rest = total - before.energy_n2[trial].sum()
        old = np.sqrt((before.error_n2.sum() - before.error_n2[trial].sum()) / rest)
        new = np.sqrt((after.error_n2.sum() - after.error_n2[trial].sum()) / rest)
        parts.append(old - new)
    spread = np.sqrt((count - 1) / count * np.sum((np.asarray(parts) - np.mean(parts)) ** 2))
    return gain, float(spread)


def interval(
    kind: type[AbstractEffect],
    name: str,
    whole: Any,
    by_fold: Any,
    laplace: float = 0.0,
    model_error: Any = 0.0,
    scale: NDArray[np.floating] | None = None,
    on_grid: bool = False,
) -> Interval:
    """Value from all trials; half-width from the fits of the folds (delete-group jackknife), or Laplace if
    wider, and beside it what the model's own error may do.

    Arguments:
        whole: [] or [N] value fitted on all trials.
        by_fold: [F] or [F, N] values of the folds.
        laplace: standard error by curvature.
        model_error: [] or [N] distance that the tolerated model error may move each value.
        scale: [N, N] of a strength: times it, the strength is in multiples of the tolerated model error, with
            the effect's other parameters held. By it is judged whether the value of no effect can be reached,
            since there they lose their meaning; default, by the surest value and its `model_error`.
        on_grid: whether the values were chosen from a grid.

    A model's error that may be several times the value undoes it; a smaller one only widens the interval.

    An angle or a shape that no fold moved at all is not a finding, unless it was chosen from a grid or is a
    whole number: its interval is all of its physical range. So is that of an angle that may be any.
    """
    unit = kind.parameters[name].unit
    value = np.atleast_1d(np.asarray(whole, dtype=float))
    values = np.asarray(by_fold, dtype=float).reshape(len(by_fold), -1)
    folds = len(values)
    if unit == "rad" and not kind.parameters[name].per_tooth:
        values = value + np.angle(np.exp(1j * (values - value)))
    spread = _jackknife(values)
    error = np.maximum(spread, laplace)
    # the surest entry; what the trials do not move (held at a bound, say), or what is nil beside the others
    # (force along x in a drill), says nothing, unless nothing moves
    moved = (spread > _UNMOVED * np.abs(value)) & (np.abs(value) > _NIL * np.abs(value).max())
    sure = np.where(moved, np.abs(value) / np.where(moved, error, 1.0), -1.0)
    tooth = int(np.argmax(sure if moved.any() else np.abs(value)))
    quantile = _quantile(folds)
    half = quantile * error + np.ravel(model_error)
    most, wide = float(value[tooth]), float(half[tooth])
    chosen = on_grid or kind.parameters[name].whole
    declared = kind.parameters[name]
    anywhere = unit == "rad" and declared.high - declared.low >= 2.0 * np.pi and wide >= np.pi
    if declared.identity is None and (anywhere or (not half.any() and not chosen)):
        return Interval(most, declared.low, declared.high, unit)
    origin = kind.parameters[name].identity or 0.0
    if scale is None:
        away = abs(most - origin)
        proven = quantile * float(error[tooth]) < away and wide <= _MOST_WIDENED * away
    else:
        counted = moved if moved.any() else ~moved
        proven = _proven((value - origin)[counted], (values - origin)[:, counted], scale[:, counted])
    ends = _ends(most, wide, kind.parameters[name], proven)
    several = (tuple(value.tolist()), tuple(half.tolist())) if len(value) > 1 else ((), ())
    return Interval(most, *ends, unit, *several)


def half_width(by_fold: Array) -> Array:
    """[...] half-width of the interval of what was fitted without each fold, `by_fold` [F, ...]."""
    return _quantile(len(by_fold)) * _jackknife(by_fold)


def _quantile(folds: int) -> float:
    return float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, max(folds - 1, 1)))


def _jackknife(values: Array) -> Array:
    """[...] standard error of what was fitted without each fold, `values` [F, ...]."""
    folds = len(values)
    return np.asarray(np.sqrt((folds - 1) / folds * np.sum((values - values.mean(axis=0)) ** 2, axis=0)))


def _proven(away: Array, by_fold: Array, scale: NDArray[np.floating]) -> bool:
    """Whether a strength is more than the trials' scatter and not less than a third of what the model's own
    error may make of it.

    Arguments:
        away: [N] strength less the value of no effect; by_fold: [F, N] of the folds.
        scale: [M, N] into multiples of the model's error. There all values are known equally well, so that
            what the trials hardly show (how wide a gap is beyond the sensor's band) does not drown the rest.

    Of several values either one must stand out by more than the best of N does by chance, or all together.
    """
    tail, freedom = 0.5 * (1.0 - CONFIDENCE), max(len(by_fold) - 1, 1)
    seen, folds = scale @ away, by_fold @ scale.T
    size, limit = float(np.linalg.norm(seen)), float(stats.t.isf(tail, freedom))
    one = np.abs(away) > stats.t.isf(tail / len(away), freedom) * _jackknife(by_fold)
    together = size > limit * np.linalg.norm(_jackknife(folds))
    along = limit * float(_jackknife(folds @ seen)) / max(size, 1e-300)
    return bool((one.any() or together) and along + 1.0 <= _MOST_WIDENED * size)


def _ends(value: float, wide: float, declared: Parameter, proven: bool) -> tuple[float, float]:
    """Ends of an interval of half-width `wide`.

    A model's error changes the size of an effect that the trials have `proven`; it does not undo it. So
    where the width would reach the value of no effect all the same, it is laid on a logarithmic scale from
    there, within the physical range. What is fitted on a logarithmic scale is told on one, of a value with
    one of no effect only where the width would reach below zero.
    """
    origin = 0.0 if declared.log and declared.identity is None else declared.identity
    if origin is None or value == origin:
        return value - wide, value + wide
    away = value - origin
    if declared.log and proven and wide >= value > 0.0:
        away, origin = value, 0.0
    elif declared.identity is not None and (wide < abs(away) or not proven):
        return value - wide, value + wide
    share = min(wide / abs(away), _WIDEST)
    low, high = sorted(origin + away * np.exp(sign * share) for sign in (-1.0, 1.0))
    return float(max(low, min(declared.low, value))), float(min(high, max(declared.high, value)))


def chance_over_trials(
    before: HeldOut, after: HeldOut, tries: int, added_n2: NDArray[np.floating] | None = None
) -> float:
    """Probability that the best of `tries` useless candidates gains as much on held-out trials, the trials
    being independent; `added_n2` [R] is the energy of what it adds to each, N^2, where it has no phase of its
    own there.

    A useless one gains neither over all trials nor, trial by trial, in energy, nor in shares of what each
    leaves, nor in more of them than it loses in, nor does what it adds go with what was left. The surest of
    these four or five (t, t, t, signed ranks, t) counts, as one of as many tries. Where a few trials hold
    most of the force, or of the error, all of them say little of what shows in every one; a hum is the same
    energy in each, whatever else they leave; the shares say little of a place that few trials reach; where
    they differ widely among trials that all gain, a mean and its scatter say less than the ranks; of what
    noise hides in some of a few trials, the correlation of what is added with what was left says most.
    """
    gain, error = gain_over_trials(before, after)
    if not np.isfinite(error):
        return 1.0
    old, new = before.error_n2.sum(axis=1), after.error_n2.sum(axis=1)
    share = (old - new) / np.maximum(old + new, 1e-300)
    count = len(share)
    ways = [gain / max(error, 1e-300), surely(old - new), surely(share)]
    if added_n2 is not None:
        size = np.sqrt(np.maximum(old * added_n2, 0.0))
        ways.append(surely((old - new + added_n2) / np.maximum(2.0 * size, 1e-100)))
    sure = max(ways)
    by_mean = float(stats.t.sf(sure, count - 1))
    moved = share[share != 0.0]  # without nil, ranks are exact and quick
    by_rank = float(stats.wilcoxon(moved, alternative="greater").pvalue) if len(moved) else 1.0
    return min((len(ways) + 1) * tries * min(by_mean, by_rank), 1.0)


def surely(gains: Array) -> float:
    """Mean of one gain a trial, [R], over its standard error; of two trials or fewer just its sign."""
    if len(gains) < 3:
        return float(np.sign(gains.mean())) * np.inf if gains.any() else 0.0
    error = float(np.std(gains, ddof=1)) / np.sqrt(len(gains))
    return float(gains.mean()) / max(error, 1e-300)


def decide(
    kind: type[AbstractEffect],
    before: HeldOut,
    after: HeldOut,
    p_chance: float,
    parameters: dict[str, Interval],
    over_trials: bool = True,
    tolerance: float = TOLERANCE,
    in_range: bool = True,
    axes: Sequence[str] = ("x", "y", "z"),
) -> Decision:
    """Apply the four tests; `over_trials` False leaves out that of the gain's standard error over trials,
    `in_range` False that of the range, of which `physical` then tells; `tolerance` is the share of the force
    that a model's own calculation may be off; `axes` names what was measured."""
    gain, error = gain_over_trials(before, after)
    asked = _errors_asked(len(before.energy_n2))
    within = gain < asked * error and chance_over_trials(before, after, 1) > CHANCE
    reasons, scattered = [], False
    if by_chance := p_chance > CHANCE:
        reasons.append(
            f"chance alone gives the best candidate as much (p = {p_chance:.2g}, limit {CHANCE:g})"
        )
    if gain < LEAST_GAIN * before.nrmse:
        reasons.append(
            f"error on held-out trials goes from {before.nrmse:.4f} to {after.nrmse:.4f}; "
            f"a fall of at least {LEAST_GAIN:.0%} is asked"
        )
    elif _accounted(before, after) < tolerance:
        reasons.append(
            f"accounts for {_accounted(before, after):.2%} of the force, less than the {tolerance:.1%} "
            "that any model's own calculation may be off"
        )
    elif scattered := over_trials and within:
        reasons.append(f"gain {gain:.4f} is within {asked:.3g} standard errors ({error:.4f}) over the trials")
    if not scattered and (axis := _paid_by(before, after, tolerance)) is not None:
        reasons.append(
            f"predicts {axes[axis]} worse on held-out trials ({before.per_axis[axis]:.4f} to "
            f"{after.per_axis[axis]:.4f} of what it measures) to have the others better"
        )
    nil = _no_effect(kind, parameters)
    reasons += nil.values()
    blurred = [why for name in kind.sharp if (why := _blurred(name, parameters[name]))]
    reasons += blurred
    beyond = {}
    for name, each in parameters.items():
        declared = kind.parameters[name]
        if declared.identity is None and declared.typical == 0.0:
            continue
        if _at_edge(each.value, declared):
            beyond[name] = (
                f"{name} runs to {each.value:.3g}{_in(each.unit)}, the edge of its physical range "
                f"{declared.low:g} to {declared.high:g}"
            )
    reasons += beyond.values() if in_range else []
    # of a mode that may be anywhere it says nothing to what edge its damping runs
    left_open = len(nil) + len(blurred) + (len(beyond) if blurred and in_range else 0)
    strong = kind.strength not in {*nil, *beyond}
    untold = bool(nil or blurred) and strong and len(reasons) == left_open
    unsure = bool(reasons) and len(reasons) == by_chance + scattered
    scattered = scattered and len(reasons) == 1
    return Decision(
        not reasons, not beyond, p_chance, gain, error, parameters, tuple(reasons), untold, scattered, unsure
    )


def _errors_asked(trials: int) -> float:
    """By how many standard errors over so many trials a gain must be more than none: of three or four they
    are known too badly themselves."""
    return STANDARD_ERRORS if trials >= _FEW_TRIALS else _quantile(trials)


def _paid_by(before: HeldOut, after: HeldOut, tolerance: float) -> int | None:
    """The axis that an effect which is not there lets go wrong, to fit another: its squared error rises by a
    quarter or more, in most of the trials, and by more than the model may be off."""
    rise = after.error_n2 - before.error_n2
    whole = rise.sum(axis=0)
    most = np.mean(rise > 0.0, axis=0) >= _MOST_TRIALS
    enough = np.maximum(_RISES * before.error_n2.sum(axis=0), tolerance**2 * before.energy_n2.sum())
    paid = np.flatnonzero(most & (whole > enough))
    return int(paid[0]) if paid.size else None


def _no_effect(kind: type[AbstractEffect], parameters: dict[str, Interval]) -> dict[str, str]:
    """In words, by name: that the strength may be that of no effect, or all of the telling parameters may."""
    nil = {
        name: why for name in (kind.strength, *kind.telling) if (why := _nil(kind, name, parameters[name]))
    }
    if not all(name in nil for name in kind.telling):
        return {name: why for name, why in nil.items() if name == kind.strength}
    return nil


def _nil(kind: type[AbstractEffect], name: str, found: Interval) -> str | None:
    """In words, that an interval holds the value of no effect; None where it does not."""
    identity = kind.parameters[name].identity
    if identity is None or not found.low <= identity <= found.high:
        return None
    return f"{name} {found.low:.3g} to {found.high:.3g}{_in(found.unit)} includes {identity:g}, no effect"


def _blurred(name: str, found: Interval) -> str | None:
    """In words, that a parameter is not known to a factor of two; None where it is."""
    if found.low > 0.0 and found.high <= _SHARP * found.low:
        return None
    lies = f"{name} {found.low:.3g} to {found.high:.3g}{_in(found.unit)}"
    return f"{lies} is not known to a factor of {_SHARP:g}"


def _at_edge(value: float, declared: Parameter) -> bool:
    """Whether a value lies at an end of its range, or beyond; one where the effect vanishes is no edge."""
    low, high = declared.low, declared.high
    if declared.log and low > 0.0:
        low, high, value = np.log(low), np.log(high), np.log(max(value, 1e-300))
    margin = _EDGE * (high - low)
    vanishes = declared.identity is not None and declared.identity == declared.low
    beneath = min(margin, _BENEATH * declared.typical) if vanishes else -margin
    return bool(value > high - margin or value < low - beneath)


def _accounted(before: HeldOut, after: HeldOut) -> float:
    """Root-mean-square of what the candidate explains on held-out trials, over that of the force."""
    return float(np.sqrt(max(before.nrmse**2 - after.nrmse**2, 0.0)))


def _in(unit: str) -> str:
    """The unit behind a number; nothing behind a bare one."""
    return "" if unit == "1" else f" {unit}"
