"""What chance alone gives the best of many useless candidates, in the fit and on held-out trials."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from mjx_cutting.tracing.fitting.heldout import HeldOut

CHANCE = 0.01
STANDARD_ERRORS = 2.0
Array = NDArray[np.float64]


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
