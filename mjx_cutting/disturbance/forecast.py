"""Whether what repeats goes on repeating: from two thirds of every trial, foretell the last third.

This is what a periodic process promises, so its share of the last third's energy is the test of periodicity,
and it settles one choice that the likelihood gets wrong. Trials that are warped, or drift, do not repeat
exactly; a process with a multiple of the true period then has more freedom and a higher likelihood, yet
foretells no better. So where the best period fits only a few times into the trials, a whole fraction of it
that was also found is preferred if it foretells as well. With many repetitions the likelihood is believed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.disturbance import search, weights
from mjx_cutting.disturbance.kernel import fourier
from mjx_cutting.disturbance.search import Found
from mjx_cutting.disturbance.statistics import Statistics

FEW = 5.0  # periods in the trials, below which the likelihood alone is not believed
AS_WELL = 0.01  # share of energy by which a shorter period may foretell less
_MULTIPLES = range(2, 9)

Real = NDArray[np.float64]


def last_third(statistics: Statistics) -> NDArray[np.bool_]:
    """Returns [R, N]: the last third of each trial's samples."""
    seen = np.all(np.isfinite(statistics.residual), axis=-1)
    order = np.cumsum(seen, 1)
    return np.asarray(seen & (order > 2 * order[:, -1:] // 3))


def foretold(statistics: Statistics, features: Real, priors: tuple[Real, Real], noise: Real) -> Real:
    """Returns [R, N, A] (scaled): each trial's mean given the first two thirds of all trials.

    Args:
        statistics: the trials.
        features: [N, m] at the stamps; priors: diag S_0 and S_1, each [A, m]; noise: [A], all scaled.
    """
    past = np.where(last_third(statistics)[..., None], np.nan, statistics.residual)
    posterior = weights.condition(features, past, priors, noise, statistics.effects != "pooled")
    return np.einsum("nm,ram->rna", features, posterior.trial_means)


def share(statistics: Statistics, fitted: Real, where: NDArray) -> tuple[Real, float]:
    """Returns the share of energy that `fitted` [R, N, A] (scaled) explains `where` [R, N]: by axis, all."""
    kept = where[..., None] & np.isfinite(statistics.residual)
    y = np.where(kept, statistics.residual, 0.0)
    error = np.where(kept, (y - fitted) ** 2, 0.0)
    by_axis = 1.0 - error.sum((0, 1)) / np.maximum(np.sum(y**2, (0, 1)), 1e-300)
    return by_axis, float(1.0 - error.sum() / max(float(np.sum(y**2)), 1e-300))


def choose(found: list[Found], statistics: Statistics, harmonics: int) -> Found:
    """Returns the optimum to keep out of those found, the most likely first (not empty)."""
    best = found[0]
    f = float(best.hyper.frequency_hz)
    if f * statistics.span_s >= FEW:
        return best
    rivals = []
    for k in _MULTIPLES:
        near = [c for c in found if abs(float(c.hyper.frequency_hz) / f - k) < 0.05 * k]
        rivals += near[:1]
    if not rivals:
        return best
    least = _foretells(best, statistics, harmonics) - AS_WELL
    scores = [_foretells(c, statistics, harmonics) for c in rivals]
    i = int(np.argmax(scores))
    return rivals[i] if scores[i] >= least else best


def _foretells(found: Found, statistics: Statistics, harmonics: int) -> float:
    h = found.hyper
    seen = search.visible_harmonics(found.start_hz, statistics.nyquist_hz, harmonics)
    phi = fourier(statistics.time_s, float(h.frequency_hz), harmonics)
    priors = search.prior_variances(h, harmonics, seen, statistics.largest_constant)
    ahead = foretold(statistics, phi, priors, h.noise)
    return share(statistics, ahead, last_third(statistics))[1]
