"""Repeated trials reduced to what the likelihood needs: one row per channel over the distinct time stamps.

Trials that share their stamps enter the likelihood only through sums over trials, so 14 trials of 2,500
samples cost as much as 2,500 samples. With counts w_i and sums over the trials at stamp i, the Gram matrix is
G = Phi' W Phi and the projected data Phi' sum_r y_r. With trial effects and a full rectangle of trials an
orthonormal change of trials (Helmert) leaves one mean channel and R - 1 contrasts, all with the same G;
with gaps each trial keeps its own row and its own G.

Breaks when trials do not share stamps: then nothing is reduced and the cost is that of the distinct stamps
(regrid trials before fitting; `trials.align` does).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MIN_STAMPS = 8
CONSTANT_FACTOR = 3.0
LEAST_CONSTANT = 0.03  # of an axis's spread: how well means over a few periods tell a constant


@dataclass(frozen=True)
class Statistics:
    """Trials of residual force on shared stamps, scaled to unit spread, with what the fit derives from them.

    `weights` [G, N] and `sums` [C, A, N] are the rows whose moments the likelihood takes: pooled: G = C = 1;
    balanced trial effects: G = 1, C = R (mean channel first); with gaps: G = C = R.
    """

    time_s: NDArray[np.float64]  # [N] distinct stamps, increasing
    residual: NDArray[np.float64]  # [R, N, A] divided by `scale`; nan where missing
    scale: NDArray[np.float64]  # [A] N: the spread of each axis
    effects: str  # "pooled" | "balanced" | "gaps"
    weights: NDArray[np.float64]  # [G, N]
    sums: NDArray[np.float64]  # [C, A, N]
    square: NDArray[np.float64]  # [A] sum of squares of the scaled samples
    count: int  # samples of each axis

    @property
    def trials(self) -> int:
        return int(self.residual.shape[0])

    @property
    def axes(self) -> int:
        return int(self.residual.shape[2])

    @property
    def span_s(self) -> float:
        """The time covered, one step included."""
        return float(self.time_s[-1] - self.time_s[0]) * len(self.time_s) / (len(self.time_s) - 1)

    @property
    def sample_rate_hz(self) -> float:
        return float(1.0 / np.median(np.diff(self.time_s)))

    @property
    def nyquist_hz(self) -> float:
        """Half the sample rate; inf where the stamps are uneven, which have no single alias."""
        return 0.5 * self.sample_rate_hz if self.uniform else float("inf")

    @property
    def uniform(self) -> bool:
        step = np.diff(self.time_s)
        return bool(np.max(np.abs(step - step.mean())) < 1e-6 * step.mean())

    @property
    def largest_constant(self) -> NDArray[np.float64]:
        """The largest standard deviation [2, A] (scaled) that the constant of the common process and that of
        a trial's own process may have: `CONSTANT_FACTOR` times what the trials' means show.

        The periodic kernel ties its constant to its other harmonics: one that is nearly a cosine (large l)
        has a constant many times larger. A force sensor's bias is taken off each trial, so its constants are
        small; without a bound the band of a new trial is that of the constant the kernel asks for. Up to the
        bound the prior is the kernel's; a normal prior this much wider than the values seen is never
        likelier than the bounded one.
        """
        means = np.nanmean(self.residual, axis=1)  # [R, A]
        own = means.var(0, ddof=1) if self.trials > 1 else np.zeros(self.axes)
        shown = np.stack([means.mean(0) ** 2, own]) + LEAST_CONSTANT**2
        return CONSTANT_FACTOR * np.sqrt(shown)

    def subset(self, trials: NDArray[np.int_] | list[int]) -> Statistics:
        """Returns the statistics of some of the trials, on the same scale."""
        return _reduce(self.time_s, self.residual[np.asarray(trials)], self.scale, self.effects != "pooled")

    def pooled(self) -> Statistics:
        """Returns the same trials taken as one process."""
        return _reduce(self.time_s, self.residual, self.scale, False)


def reduce(time_s: NDArray, residual_n: NDArray, trial_effects: bool = True) -> Statistics:
    """Returns the statistics of trials of residual force on shared stamps.

    Args:
        time_s: stamps [N], s, increasing; the same for all trials.
        residual_n: measured minus model [R, N, A] (or [R, N] for one axis, [N] for one trial of one axis), N;
            A from 1 to 3; nan where a trial has no sample (all axes at once).
        trial_effects: whether each trial has a process of its own beside the common one; needs R >= 2, with
            one trial the pooled model is used.

    Raises:
        ValueError: shapes that do not fit, stamps that do not increase, infinite values, a stamp or trial
            without a sample, too few stamps, or an axis that is constant.
    """
    time = np.asarray(time_s, np.float64)
    residual = np.asarray(residual_n, np.float64)
    if residual.ndim == 1:
        residual = residual[None, :, None]
    elif residual.ndim == 2:
        residual = residual[:, :, None]
    _check(time, residual)
    seen = np.all(np.isfinite(residual), axis=-1)
    keep = seen.any(0)
    time, residual = time[keep], residual[:, keep]
    scale = np.array([np.std(residual[..., a][seen[:, keep]]) for a in range(residual.shape[-1])])
    if np.any(scale <= 0):
        axes = ", ".join(str(a) for a in np.flatnonzero(scale <= 0))
        raise ValueError(
            f"axis {axes} of the residual is constant; expected a varying force. Leave that axis out "
            "(residual_n[..., axes]) or check the sensor's channel."
        )
    return _reduce(time, residual / scale, scale, trial_effects)


def _reduce(time: NDArray, residual: NDArray, scale: NDArray, trial_effects: bool) -> Statistics:
    seen = np.all(np.isfinite(residual), axis=-1)
    filled = np.where(seen[..., None], residual, 0.0)
    trials = len(residual)
    square = np.sum(filled**2, axis=(0, 1))
    rows = np.moveaxis(filled, -1, 1)  # [R, A, N]
    if not trial_effects or trials < 2:
        effects, weights, sums = "pooled", seen.sum(0, keepdims=True), rows.sum(0, keepdims=True)
    elif seen.all():
        effects, weights = "balanced", seen[:1]
        sums = np.tensordot(helmert(trials), rows, axes=(1, 0))
    else:
        effects, weights, sums = "gaps", seen, rows
    return Statistics(
        time, residual, scale, effects, weights.astype(np.float64), sums, square, int(seen.sum())
    )


def helmert(trials: int) -> NDArray[np.float64]:
    """Returns the orthonormal [R, R] whose first row averages the trials and whose others are contrasts."""
    matrix = np.tril(np.ones((trials, trials)), -1)
    matrix -= np.diag(np.arange(trials, dtype=np.float64))
    matrix[0] = 1.0
    return matrix / np.linalg.norm(matrix, axis=1, keepdims=True)


def spread_noise(statistics: Statistics) -> NDArray[np.float64]:
    """Returns the noise [A] (scaled) that the samples show: the least of the spread between trials within a
    stamp and, on an even grid, the third difference within a trial (which trial effects leave alone)."""
    residual = statistics.residual
    found = []
    seen = np.all(np.isfinite(residual), axis=-1)
    many = seen.sum(0) > 1
    if many.any():
        some = residual[:, many]
        freedom = np.sum(seen[:, many].sum(0) - 1)
        within = np.nansum((some - np.nanmean(some, axis=0)) ** 2, axis=(0, 1)) / freedom
        found.append(within)
    difference = np.diff(residual, n=3, axis=1)
    if np.isfinite(difference).any():
        found.append(np.nanmean(difference**2, axis=(0, 1)) / 20.0)
    return np.sqrt(np.maximum(np.min(found, axis=0), 1e-8))


def _check(time: NDArray, residual: NDArray) -> None:
    if time.ndim != 1 or residual.ndim != 3 or residual.shape[1] != len(time):
        raise ValueError(
            f"got time_s {time.shape} and residual_n {residual.shape}; expected [N] and [R, N, A] on shared "
            "stamps. Align the trials first (mjx_cutting.trials.align)."
        )
    if not 1 <= residual.shape[2] <= 3 or residual.shape[0] < 1:
        raise ValueError(f"residual_n has shape {residual.shape}; expected [R >= 1, N, 1 to 3 axes]")
    if not np.isfinite(time).all() or np.any(np.diff(time) <= 0):
        raise ValueError("time_s must be finite and strictly increasing; sort it and average repeated stamps")
    if np.isinf(residual).any():
        raise ValueError(
            "residual_n has infinite values; expected newtons, nan only where a sample is missing"
        )
    missing = np.isnan(residual)
    if np.any(missing.any(-1) != missing.all(-1)):
        raise ValueError(
            "residual_n is nan on some axes of a sample and not on others; expected all axes of a sample or "
            "none. Set the whole sample to nan, or fill the gap."
        )
    seen = ~missing.any(-1)
    if not seen.any(1).all():
        empty = ", ".join(str(i) for i in np.flatnonzero(~seen.any(1)))
        raise ValueError(f"trial {empty} of residual_n has no sample; leave it out")
    if np.sum(seen.any(0)) < MIN_STAMPS:
        raise ValueError(
            f"got {int(np.sum(seen.any(0)))} stamps with samples; expected at least {MIN_STAMPS}"
        )
