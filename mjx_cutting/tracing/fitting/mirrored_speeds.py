"""Which of two speeds the spindle had, at which tooth passing folds to the same place.

Beyond half the sampling rate a line comes back from there, and turns backwards in time. So the lines of
tooth passing at N f and those at k F - N f, F the sampling rate, stand at the same frequencies, and their
energy does not tell the two speeds f apart (`mirror_speed`). But one is the other played backwards, and a
tooth that bites thin and leaves thick is not the same backwards: the base model tells them apart.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.problem import Problem, pose
from mjx_cutting.tracing.records.comb import RESOLVED, SPREAD
from mjx_cutting.tracing.records.course import rate_hz
from mjx_cutting.tracing.records.lines import Lines, compress
from mjx_cutting.tracing.records.spindle import mirror_speed, stated_speed
from mjx_cutting.trials.dataset import Dataset

_CLEARLY_LESS = 0.8
_ROUNDS = 3
Array = NDArray[np.floating]


def from_the_right_side(dataset: Dataset, lines: Lines) -> Lines:
    """The lines; of trials that a base model fits clearly better at the mirrored speed, those there (call it
    in float64)."""
    mirror = _mirrors(dataset, lines)
    twofold = np.isfinite(mirror)
    for _ in range(_ROUNDS if twofold.any() else 0):
        problem, fit = fit_base(pose(dataset, lines))
        about = np.where(twofold, mirror, lines.speed_rev_s)
        other = compress(dataset, lines.band_hz, about_rev_s=about)
        here, there = (_left(each, dataset, problem, np.asarray(fit.x)) for each in (lines, other))
        turned = twofold & (there < _CLEARLY_LESS * here)
        if not turned.any():
            break
        about, mirror = (
            np.where(turned, a, b) for a, b in ((mirror, lines.speed_rev_s), (lines.speed_rev_s, mirror))
        )
        lines = compress(dataset, lines.band_hz, about_rev_s=about)
    return lines


def _mirrors(dataset: Dataset, lines: Lines) -> Array:
    """[R] the other speed that folds tooth passing alike, rev/s; nan where it is farther off than a stated
    speed may err, is not told from the first, or the angle was measured."""
    trials = [trial for trial in dataset.trials if trial.kind == "cut"]
    teeth, found = dataset.tool.teeth, np.full(len(trials), np.nan)
    for index, (trial, speed) in enumerate(zip(trials, lines.speed_rev_s, strict=True)):
        mirror, stated = mirror_speed(float(speed), teeth, rate_hz(trial)), stated_speed(trial)
        apart = teeth * abs(mirror - speed) * float(np.ptp(trial.time_s)) > RESOLVED
        if apart and abs(mirror - stated) < SPREAD * stated and trial.spindle_angle_rad is None:
            found[index] = mirror
    return found


def _left(lines: Lines, dataset: Dataset, problem: Problem, x: Array) -> Array:
    """[R] what the base model at the unknowns `x` [U] of a problem leaves on each trial's lines, N^2."""
    posed = pose(dataset, lines)
    own = replace(posed, scale=problem.scale, bias_unit_n=problem.bias_unit_n, weight=problem.weight)
    error_n2 = Descent(own, ()).rows(x[None]).error_n2[0]
    return np.asarray(error_n2.sum(axis=-1) + lines.rest_n2.sum(axis=-1))
