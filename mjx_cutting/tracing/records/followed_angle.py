"""Whether the force follows what a measured angle shows within the turn.

An encoder off its centre, or whose scale errs, shows an angle that is uneven in the same way every turn while
the spindle turns evenly. Along such an angle every line gets sidebands, as from runout or teeth of unequal
pitch. What repeats every turn is left out of the measured angle where tooth passing and its harmonics hold
more of the force without it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.turns import filtered_turns, real_columns, swing
from mjx_cutting.trials.dataset import Dataset, Sensor, Trial

_TOOTH_HARMONICS = 4
_SAMPLES_PER_ORDER = 8
_LEAST_RAD = 1e-5
Array = NDArray[np.floating]


def as_followed(dataset: Dataset) -> Dataset:
    """The data set, of the measured angles of its cuts only what the force follows."""
    if dataset.tool.kind in LEVEL_KINDS:
        return dataset
    trials = (_followed(trial, dataset.sensor, dataset.tool.teeth) for trial in dataset.trials)
    return replace(dataset, trials=tuple(trials))


def _followed(trial: Trial, sensor: Sensor, teeth: int) -> Trial:
    if trial.spindle_angle_rad is None or trial.kind != "cut":
        return trial
    angle = np.unwrap(trial.spindle_angle_rad)
    repeats = swing(angle)
    if np.ptp(repeats) < _LEAST_RAD:
        return trial
    per_turn = 2.0 * np.pi * len(angle) / float(np.ptp(angle))
    orders = int(min(_TOOTH_HARMONICS * teeth, per_turn / 2.0, len(angle) / _SAMPLES_PER_ORDER))
    of_teeth = np.arange(0, max(orders, teeth) + 1, teeth)
    measured, even = (_left(trial.force_n, each, of_teeth, sensor) for each in (angle, angle - repeats))
    return trial if measured <= even else replace(trial, spindle_angle_rad=angle - repeats)


def _left(force_n: Array, angle_rad: Array, orders: NDArray[np.int64], sensor: Sensor) -> float:
    """Energy of the force [T, 3] that no line of those orders along the angle [T] explains, N^2."""
    columns = real_columns(filtered_turns(angle_rad, int(orders[-1]), sensor)[orders])
    weights, *_ = np.linalg.lstsq(columns, force_n, rcond=None)
    return float(np.sum((force_n - columns @ weights) ** 2))
