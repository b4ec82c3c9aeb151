"""When a slow spindle is believed: records may tell a speed below the stated one that no motor had.

A motor that gives way under the cut turns slower, and its lines stand there (`spindle`). But a strong
vibration has lines of its own, which those of a slower spindle may fall on. So a slow speed is believed only
where the base model, fitted to the lines at it, leaves clearly less than at speeds near the stated one. Where
tooth passing lies beyond the band, the base model has no line to be told by: then one does in which a tooth
cuts unlike another.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import effect_starts, fit_base
from mjx_cutting.tracing.fitting.mirrored_speeds import from_the_right_side
from mjx_cutting.tracing.fitting.problem import pose
from mjx_cutting.tracing.records.comb import SPREAD
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import Lines, compress
from mjx_cutting.tracing.records.spindle import stated_speed
from mjx_cutting.trials.dataset import Dataset

_CLEARLY_LESS = 0.8
_ONCE_A_TURN = ("radial_runout", "unequal_pitch", "broken_tooth", "unbalance")
_STEPS = 8


def lines_as_it_turned(dataset: Dataset, band_hz: tuple[float, float]) -> Lines:
    """Lines at the speeds that the records tell, where those are believed (call it in float64)."""
    lines = compress(dataset, band_hz)
    stated = np.array([stated_speed(trial) for trial in dataset.trials if trial.kind == "cut"])
    if dataset.tool.kind in LEVEL_KINDS:
        return lines
    if np.any(lines.speed_rev_s < (1.0 - SPREAD) * stated):
        near = compress(dataset, band_hz, about_rev_s=stated)
        lines = lines if _tells_more(dataset, lines, near) else near
    return from_the_right_side(dataset, lines)


def _tells_more(dataset: Dataset, lines: Lines, near: Lines) -> bool:
    """Whether a model leaves clearly less of the force at the speeds of `lines` than at those `near`."""
    slow, stated = _Left(dataset, lines), _Left(dataset, near)
    if slow.base() < _CLEARLY_LESS * stated.base():
        return True
    # what never could tell more needs no fit
    return slow.least < _CLEARLY_LESS * stated.base() and any(
        slow.beside(name) < _CLEARLY_LESS * stated.beside(name) for name in _ONCE_A_TURN
    )


class _Left:
    """Share of the energy that models leave, fitted to all trials; `least` whatever they say."""

    def __init__(self, dataset: Dataset, lines: Lines):
        self.lines = lines
        self.problem, self.fit = fit_base(pose(dataset, lines))
        self.least = self._share(0.0)

    def base(self) -> float:
        """By the base model."""
        return self._share(self.fit.error_n2)

    def beside(self, name: str) -> float:
        """By the base model with an effect."""
        kind = effect_class(name)
        descent = Descent(self.problem, (kind,))
        starts = effect_starts(self.problem, kind, self.fit.x)
        best = min((descent.descend(start, _STEPS) for start in starts), key=lambda each: each[1])[0]
        return self._share(descent.rows(best[None]).error_n2)

    def _share(self, error_n2: ArrayLike) -> float:
        left = np.asarray(error_n2).sum() + self.lines.rest_n2.sum()
        return float(left / self.lines.energy_n2.sum())
