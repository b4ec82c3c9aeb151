"""Does a figure of each trial go with a condition of the trials, beyond chance?

Trials, not samples, are the independent units: a rank correlation with random pairings, a straight line over
the ranks, a slow curve. Each gives the chance of it, and the share of the energy that goes with it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

_PERMUTATIONS = 4000
_FEWEST_OF_A_CURVE = 8
_CURVE_TERMS = 5
Array = NDArray[np.floating]


def ranked(values: Array, figure: Array, energy: float) -> tuple[float, float]:
    """Chance of the rank correlation of a trial's figure with a condition, and the share of energy in it."""
    rank = stats.spearmanr(values, figure).statistic
    shuffled = _shuffled_ranks(values, figure)
    p_value = (1 + np.sum(np.abs(shuffled) >= abs(rank) - 1e-12)) / (1 + len(shuffled))
    return float(p_value), float(rank**2 * energy)


def straight(values: Array, factor: Array, energy: float) -> tuple[float, float]:
    """The same for a factor or a level, straight over the ranks of the condition."""
    if np.ptp(factor) == 0.0:
        return 1.0, 0.0
    found = stats.pearsonr(stats.rankdata(values), factor)
    return float(found.pvalue), float(found.statistic**2 * energy)


def curved(values: Array, factor: Array, energy: float) -> tuple[float, float]:
    """The same for a slow curve over the condition; of fewer than eight trials none is told."""
    count = len(factor)
    if count < _FEWEST_OF_A_CURVE or np.ptp(factor) == 0.0:
        return 1.0, 0.0
    terms = min(_CURVE_TERMS, (count - 1) // 2)
    u = 2.0 * (values - values.min()) / np.ptp(values) - 1.0
    columns = np.polynomial.chebyshev.chebvander(u, terms)
    weights, *_ = np.linalg.lstsq(columns, factor, rcond=None)
    left = float(np.sum((factor - columns @ weights) ** 2)) / float(np.sum((factor - factor.mean()) ** 2))
    freedom = count - 1 - terms
    statistic = (1.0 - left) / terms / max(left / freedom, 1e-300)
    return float(stats.f.sf(statistic, terms, freedom)), (1.0 - left) * energy


def _shuffled_ranks(values: Array, size: Array) -> Array:
    """Rank correlations under random pairings, from a fixed seed."""
    generator = np.random.default_rng(0)
    first, second = stats.rankdata(values), stats.rankdata(size)
    first, second = first - first.mean(), second - second.mean()
    norm = np.sqrt(np.sum(first**2) * np.sum(second**2))
    return np.array([first @ generator.permutation(second) for _ in range(_PERMUTATIONS)]) / norm
