"""How surely a parameter is known: by the folds, by curvature, and for what the model's own error may do.

A strength whose interval holds the value of no effect is not proven; one that is proven is not undone by the
model's error, which only widens it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.cutting.effects import Parameter

CONFIDENCE = 0.95
_UNMOVED = 1e-6
_NIL = 1e-9
_MOST_WIDENED = 3.0
_WIDEST = 50.0
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
    times = quantile(folds)
    half = times * error + np.ravel(model_error)
    most, wide = float(value[tooth]), float(half[tooth])
    chosen = on_grid or kind.parameters[name].whole
    declared = kind.parameters[name]
    anywhere = unit == "rad" and declared.high - declared.low >= 2.0 * np.pi and wide >= np.pi
    if declared.identity is None and (anywhere or (not half.any() and not chosen)):
        return Interval(most, declared.low, declared.high, unit)
    origin = kind.parameters[name].identity or 0.0
    if scale is None:
        away = abs(most - origin)
        proven = times * float(error[tooth]) < away and wide <= _MOST_WIDENED * away
    else:
        counted = moved if moved.any() else ~moved
        proven = _proven((value - origin)[counted], (values - origin)[:, counted], scale[:, counted])
    ends = _ends(most, wide, kind.parameters[name], proven)
    several = (tuple(value.tolist()), tuple(half.tolist())) if len(value) > 1 else ((), ())
    return Interval(most, *ends, unit, *several)


def half_width(by_fold: Array) -> Array:
    """[...] half-width of the interval of what was fitted without each fold, `by_fold` [F, ...]."""
    return quantile(len(by_fold)) * _jackknife(by_fold)


def quantile(folds: int) -> float:
    """Standard errors that an interval of `CONFIDENCE` has to either side, by so many folds."""
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
