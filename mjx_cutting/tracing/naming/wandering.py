"""Do levels differ by more than the force wanders within each of them?

A drill or a lathe tells one level a trial, and few trials tell few levels: with several constants and the
unknowns of an effect nearly anything fits them. What is left within the trials then says what their levels
are worth. A gain that walks, or follows the place, or slides as chips jam moves the mean of a trial by about
as much as it moves the force within it. So what steady effects explain must be more, for each of their
unknowns, than chance makes of such levels. Where the force is even within the trials, nothing is asked.

The assumption that breaks it: that what moves the force within a trial is not the same in all of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import Effects
from mjx_cutting.tracing.fitting.prediction import Prediction, energy
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.naming.chance import CHANCE

_TERMS = 5
Array = NDArray[np.floating]


def rather_wandering(
    problem: Problem,
    effects: Effects,
    base_x: Array,
    x: Array,
    after: Sequence[Prediction],
    tries: int,
) -> str | None:
    """Why steady `effects` of levels are refused that explain no more of them than their wandering may do;
    None where they explain more.

    Arguments:
        base_x, x: unknowns of the base model and of that with the effects.
        after: every cut trial beside the prediction of all that was found, also along the trials.
        tries: how many were tried.
    """
    before, told_before = _levels(problem, (), base_x)
    left, told = _levels(problem, effects, x)
    weight = np.asarray(problem.weight)
    slow = [_slow(each.residual_n) for each in after]
    size = np.linalg.svd(np.concatenate(slow) * weight, compute_uv=False) ** 2
    directions = float(size.sum() ** 2 / max(np.sum(size**2), 1e-300))
    of_one = float(size.sum()) / len(after) / directions
    added = max(told - told_before, 1)
    statistic = max(before - left, 0.0) / added / max(of_one, 1e-300)
    by_chance = min(tries * float(stats.f.sf(statistic, added, len(after))), 1.0)
    if by_chance <= CHANCE:
        return None
    share = np.sqrt(energy(slow) / max(energy([each.measured_n for each in after]), 1e-300))
    return (
        f"within the trials what is left wanders by {share:.1%} of the force, and levels that do as much "
        f"differ as these do by chance (p = {by_chance:.2g}, limit {CHANCE:g})"
    )


def _levels(problem: Problem, effects: Effects, x: Array) -> tuple[float, int]:
    """Weighted square of what a model leaves of the levels, and how many unknowns they tell."""
    descent = Descent(problem, effects)
    left = np.asarray(descent.rows(np.asarray(x)[None]).left)[0, : descent.measured]
    return float(np.sum(left**2)), descent.told(np.asarray(x))


def _slow(left_n: Array) -> Array:
    """[T, 3] slow curve through what is left of a trial, without its mean."""
    u = np.linspace(-1.0, 1.0, len(left_n))
    columns = np.polynomial.chebyshev.chebvander(u, _TERMS)[:, 1:]
    basis, _ = np.linalg.qr(columns - columns.mean(axis=0))
    return np.asarray(basis @ (basis.T @ left_n))
