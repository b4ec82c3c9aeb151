"""When a slow spindle is believed: records may tell a speed below the stated one that no motor had.

A motor that gives way under the cut turns slower, and its lines stand there (`spindle`). But a strong
vibration has lines of its own, which those of a slower spindle may fall on. So a slow speed is believed only
where the base model, fitted to the lines at it, leaves clearly less than at speeds near the stated one.
"""

from __future__ import annotations

import numpy as np

from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.problem import pose
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import Lines, compress
from mjx_cutting.tracing.records.spindle import SPREAD, stated_speed
from mjx_cutting.trials.dataset import Dataset

_CLEARLY_LESS = 0.8


def lines_as_it_turned(dataset: Dataset, band_hz: tuple[float, float]) -> Lines:
    """Lines at the speeds that the records tell, where those are believed (call it in float64)."""
    lines = compress(dataset, band_hz)
    stated = np.array([stated_speed(trial) for trial in dataset.trials if trial.kind == "cut"])
    if dataset.tool.kind in LEVEL_KINDS or not np.any(lines.speed_rev_s < (1.0 - SPREAD) * stated):
        return lines
    near = compress(dataset, band_hz, about_rev_s=stated)
    return lines if _left(dataset, lines) < _CLEARLY_LESS * _left(dataset, near) else near


def _left(dataset: Dataset, lines: Lines) -> float:
    """Share of the energy that the base model leaves, fitted to all trials."""
    _, base = fit_base(pose(dataset, lines))
    error = np.asarray(base.error_n2).sum() + lines.rest_n2.sum()
    return float(error / lines.energy_n2.sum())
