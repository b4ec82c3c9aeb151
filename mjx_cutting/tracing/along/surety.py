"""How surely a slow effect's size is known, by the fits without each fold and the steady model's error."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.along.kind import Kind, as_values
from mjx_cutting.tracing.naming.intervals import Interval, half_width, interval
from mjx_cutting.tracing.records.course import Course

_MOST_UNSURE = 2.0
Array = NDArray[np.floating]


def reach_of_the_model(kind: Kind, trials: Sequence[Course], shape: Array) -> float:
    """How much of its own error a model of the cut can put where the effect acts, 0 to 1.

    What starts each trial at a phase of its own, whatever the spindle does, stands beside the lines of the
    cut: there, a wrong calculation has its share of what is calculated. All other effects act on just that.
    """
    if not kind.own_phase:
        return 1.0
    there = whole = 0.0
    for course in trials:
        columns = kind.columns(course, shape)
        columns = columns.reshape(-1, columns.shape[-1])
        force = (course.chip_n + course.edge_n).ravel()
        there += float(np.sum((columns @ np.linalg.lstsq(columns, force, rcond=None)[0]) ** 2))
        whole += float(np.sum(force**2))
    return float(np.sqrt(there / max(whole, 1e-300)))


def intervals(
    kind: Kind, effect: AbstractEffect, by_fold: list[dict[str, Array]], unsure: float
) -> dict[str, Interval]:
    """Intervals by name; by the model's own error the strength may be off by the share `unsure` of it."""
    whole, found = as_values(effect), {}
    for name in (each for each in kind.effect.parameters if each in whole):
        error = unsure * np.abs(whole[name]) if name == kind.effect.strength else 0.0
        by_name = np.stack([each[name] for each in by_fold])
        declared = kind.effect.parameters[name]
        usual = declared.typical if declared.identity is None else declared.identity
        if name in kind.untold and not np.any(np.append(by_name, whole[name]) != usual):
            found[name] = Interval(float(whole[name]), declared.low, declared.high, declared.unit)
            continue
        found[name] = interval(kind.effect, name, whole[name], by_name, model_error=error, on_grid=True)
    return found


def unsure_force(kind: Kind, trials: Sequence[Course], shape: Array, c: Array, weight: Array) -> float:
    """Half-width of the interval of the force that an effect is a share of, over that force: how far the
    steady models that were fitted without a fold differ."""
    found = []
    of_all = [(kind.columns(course, shape) @ c) * weight for course in trials]
    for fold in range(len(trials[0].chip_by_fold)):
        common = energy = 0.0
        for course, whole in zip(trials, of_all, strict=True):
            other = (kind.columns(course.without(fold), shape) @ c) * weight
            common += float(np.sum(whole * other))
            energy += float(np.sum(other**2))
        found.append(common / max(energy, 1e-300))
    half = half_width(np.asarray(found)[:, None]) if found else np.zeros(1)
    return min(float(half[0]), _MOST_UNSURE)
