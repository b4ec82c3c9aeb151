"""What alignment needs of sampled signals: lags, values between samples, re-indexing, the strongest period.

Values between samples come from a sine cardinal under a Lanczos window, which keeps the variance of white
noise to a few percent where linear interpolation would halve it. Breaks near the ends, where the last value
is repeated.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal

_TAPS = 8  # on each side

Real = NDArray[np.float64]


def coarse_lags(standard: Sequence[Real], most: float) -> Real:
    """Returns [R] lags in samples (fractional) against the trial most like the others: x_r(t + lag) ~ x(t).

    Args:
        standard: R standardised arrays [T_r, C].
        most: largest lag, samples.
    """
    count = len(standard)
    score, lag = np.zeros((count, count)), np.zeros((count, count))
    for q in range(count):
        for r in range(q):
            score[q, r], lag[q, r] = _correlate(standard[q], standard[r], int(most))
            score[r, q], lag[r, q] = score[q, r], -lag[q, r]
    reference = int(np.argmax(score.sum(0)))
    return lag[:, reference]


def dominant_period(values: Real, step_s: float) -> float:
    """Returns the period [s] of the strongest line of [R, N, C], trials averaged (nan: too short).

    The spectrum is padded 16-fold and its peak refined by a parabola; below two periods nothing is called
    one.
    """
    power: Any = 0.0
    size = values.shape[1]
    padded = 16 * size
    for trial in values:
        seen = np.isfinite(trial).all(-1)
        centred = np.where(seen[:, None], trial - np.nanmean(trial, 0), 0.0)
        scale = np.maximum(np.nanstd(trial, 0), 1e-300)
        window = np.hanning(size)[:, None]
        power = power + np.sum(np.abs(np.fft.rfft(window * centred / scale, padded, axis=0)) ** 2, 1)
    least = 2 * padded // size
    if len(power) <= least + 2:
        return float("nan")
    peak = least + int(np.argmax(power[least:-1]))
    a, b, c = np.log(power[peak - 1 : peak + 2] + 1e-300)
    offset = 0.5 * (a - c) / (a - 2 * b + c) if a - 2 * b + c != 0 else 0.0
    return float(padded * step_s / (peak + offset))


def interpolate(values: Real, at: Real) -> Real:
    """Returns [K, C]: `values` [T, C] at fractional samples `at` [K], nan where that is nan."""
    known = np.where(np.isfinite(at), at, 0.0)
    whole = np.floor(known).astype(int)
    taps = np.arange(1 - _TAPS, _TAPS + 1)
    apart = (known - whole)[:, None] - taps
    weights = np.sinc(apart) * np.sinc(apart / _TAPS)
    weights /= weights.sum(1, keepdims=True)
    index = np.clip(whole[:, None] + taps, 0, len(values) - 1)
    result = np.einsum("kt,ktc->kc", weights, values[index])
    return np.where(np.isfinite(at)[:, None], result, np.nan)


def reindex(placed: Real, matches: NDArray[np.int64] | None, stamps: int) -> Real:
    """Returns [stamps, C]: what met at each stamp of the reference, averaged; nan where nothing did."""
    result = np.full((stamps, placed.shape[1]), np.nan)
    if matches is None:
        kept = min(stamps, len(placed))
        result[:kept] = placed[:kept]
        return result
    total, count = np.zeros_like(result), np.zeros(stamps)
    np.add.at(total, matches[:, 1], placed[matches[:, 0]])
    np.add.at(count, matches[:, 1], 1.0)
    met = count > 0
    result[met] = total[met] / count[met, None]
    return result


def _correlate(x: Real, y: Real, most: int) -> tuple[float, float]:
    """Returns (peak, lag) of the cross-correlation of x(t + lag) with y(t), |lag| <= most, over channels."""
    total: Any = 0.0
    for c in range(x.shape[1]):
        total = total + signal.correlate(x[:, c], y[:, c], method="fft")
    lags = signal.correlation_lags(len(x), len(y))
    near = np.abs(lags) <= max(most, 0)
    total, lags = total[near], lags[near]
    peak = int(np.argmax(total))  # by the plain sum, which prefers the smaller of lags one period apart
    # the sum's peak is drawn towards 0 and by what only one record holds: refine it on what both hold
    close = lags[max(peak - 4, 0) : peak + 5]
    likeness = np.array([_likeness(x, y, int(lag)) for lag in close])
    top, offset = int(np.argmax(likeness)), 0.0
    if 0 < top < len(likeness) - 1:
        a, b, c = likeness[top - 1 : top + 2]
        offset = 0.5 * (a - c) / (a - 2 * b + c) if a - 2 * b + c < 0 else 0.0
    return float(total[peak] / np.sqrt(x.size * y.size)), float(close[top] + offset)


def _likeness(x: Real, y: Real, lag: int) -> float:
    """Returns the correlation of x(t + lag) with y(t) over their overlap, channels averaged."""
    first, last = max(0, -lag), min(len(y), len(x) - lag)
    if last - first < 2:
        return -np.inf
    a, b = x[first + lag : last + lag], y[first:last]
    a, b = a - a.mean(0), b - b.mean(0)
    norm = np.sqrt(np.sum(a**2, 0) * np.sum(b**2, 0))
    return float(np.mean(np.where(norm > 0, np.sum(a * b, 0) / np.where(norm > 0, norm, 1.0), 0.0)))
