"""Repeated trials brought onto one clock, so that what they share can be told from what they do not.

Without a measured coordinate: (1) each channel is standardised (mean and deviation kept); (2) every trial is
shifted by the sub-sample lag at which its cross-correlation with a provisional reference peaks; (3) every
ordered pair is warped (open-end symmetric2, `dtw`), the medoid under that distance is the reference; (4) the
samples are re-indexed along the optimal path to it, those that meet at one reference sample being averaged.
The lag and the path are found on the standardised force and applied to whatever is given, in newtons.

Where the spindle angle or the position along the cut was measured in all trials they are interpolated onto
one grid of that variable instead, which is better: nothing is estimated. The clock is then the variable
divided by its mean rate. Reference: Sakoe & Chiba 1978 for the warp.

Breaks where trials do not repeat: a warp then matches noise with noise and distorts periods. Bound it
(`warp_radius_s`) or leave it out, and compare the period before and after, which the report gives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjx_cutting.trials import dtw
from mjx_cutting.trials.dataset import Trial
from mjx_cutting.trials.resampling import coarse_lags, dominant_period, interpolate, reindex

VARIABLES = ("auto", "spindle_angle", "position", "time")
MEASURED_SHARE = 0.9  # of a measured coordinate's steps that must go forward for it to serve as a clock

Real = NDArray[np.float64]
Matches = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Alignment:
    """How R trials were brought onto one clock; `apply` does the same to other series of the same trials.

    Fields:
        variable: "time", "position" or "spindle_angle": what was aligned; `reason` says why that one.
        time_s: [N] the common clock, s, even steps.
        sources: R arrays [K >= N] of the (fractional) sample of each trial at each stamp, before the warp;
            nan where the trial has none.
        matches: for each trial [L, 2] of (stamp before the warp, stamp after), or None: not warped.
        mean, deviation: [R, C] standardisation of each trial's channels, N.
        reference: the trial whose clock it is; -1 where a measured variable gave the clock.
        lag_s: [R] by how much later than the reference each trial started its cut, s.
        distance: [R, R] normalised warp distance, query by row; nan where none was computed.
        before, shifted, after: [R, N, C] the series in their own unit: each on its own clock, shifted only
            (on a measured coordinate: as `after`), and aligned; nan where a trial has no sample.
    """

    variable: str
    reason: str
    time_s: Real
    sources: tuple[Real, ...]
    matches: tuple[Matches | None, ...]
    mean: Real
    deviation: Real
    reference: int
    lag_s: Real
    distance: Real
    before: Real
    shifted: Real
    after: Real

    def apply(self, series: Sequence[ArrayLike], *, warp: bool = True) -> Real:
        """Returns [R, N, C]: series of the same trials on the common clock, nan where a trial has no sample.

        Args:
            series: R arrays [T_r, C] sampled as the trials were, the residual force (N) for instance.
            warp: follow the warp too, not the shift alone.

        Raises:
            ValueError: another number of trials, fewer samples than a trial had, or values that are not
                finite.
        """
        if len(series) != len(self.sources):
            raise ValueError(f"got {len(series)} series; expected one for each of {len(self.sources)} trials")
        matches = self.matches if warp else (None,) * len(series)
        arrays = [dtw.checked_series(s, f"series {r}") for r, s in enumerate(series)]
        stamps = len(self.time_s)
        pairs = zip(arrays, self.sources, matches, strict=True)
        return np.stack([reindex(interpolate(a, at), m, stamps) for a, at, m in pairs])

    def report(self) -> dict[str, Any]:
        """Returns what alignment did, in plain numbers: lags, warp, coverage, spread, period.

        `spread` is the root mean square deviation of the trials from their mean over that of the mean itself.
        """
        step = float(self.time_s[1] - self.time_s[0])
        warped = [m for m in self.matches if m is not None]
        moved = np.concatenate([np.abs(m[:, 0] - m[:, 1]) * step for m in warped]) if warped else np.zeros(1)
        aside = [float(np.mean(np.diff(m, axis=0).min(1) == 0)) for m in warped]
        return {
            "variable": self.variable,
            "reason": self.reason,
            "reference": self.reference,
            "lag_s": self.lag_s.tolist(),
            "warp_rms_s": float(np.sqrt(np.mean(moved**2))),
            "warp_max_s": float(moved.max()),
            "warp_steps_share": float(np.mean(aside)) if aside else 0.0,
            "coverage": np.isfinite(self.after).all(-1).mean(1).tolist(),
            "spread_before": _spread(self.before),
            "spread_shifted": _spread(self.shifted),
            "spread_after": _spread(self.after),
            "period_before_s": dominant_period(self.before, step),
            "period_shifted_s": dominant_period(self.shifted, step),
            "period_after_s": dominant_period(self.after, step),
        }


def align_trials(
    trials: Sequence[Trial],
    sample_rate_hz: float,
    *,
    variable: str = "auto",
    warp: bool = True,
    max_lag_s: float | None = None,
    warp_radius_s: float | None = None,
) -> Alignment:
    """Returns the alignment of measured trials, in spindle angle or position where all trials measured it.

    Args:
        trials: of one dataset; force channels that are not finite in a trial (a drill's) are left out.
        sample_rate_hz: of the sensor, Hz.
        variable: "auto" (spindle angle, else position, else time), or one of these by name.
        warp, max_lag_s, warp_radius_s: as in `align`, for time.

    Raises:
        ValueError: no trial, an unknown variable, one that was asked for and not measured; else as `align`.
    """
    if variable not in VARIABLES:
        raise ValueError(f"got variable {variable!r}; expected one of {', '.join(VARIABLES)}")
    if not trials:
        raise ValueError("got no trial; expected at least one")
    finite = np.all([np.isfinite(t.force_n).all(0) for t in trials], axis=0)
    series = [t.force_n[:, finite] for t in trials]
    refused = []
    for name in ("spindle_angle", "position"):
        if variable not in ("auto", name):
            continue
        coordinates, reason = _coordinates(trials, name)
        if coordinates is not None:
            return align_measured(series, coordinates, sample_rate_hz, name)
        if variable == name:
            raise ValueError(f"cannot align in {name}: {reason}. Ask for another variable, or 'auto'")
        refused.append(reason)
    found = align(series, sample_rate_hz, warp=warp, max_lag_s=max_lag_s, warp_radius_s=warp_radius_s)
    return replace(found, reason="; ".join(refused) or "asked for")


def align(
    series: Sequence[ArrayLike],
    sample_rate_hz: float,
    *,
    warp: bool = True,
    max_lag_s: float | None = None,
    warp_radius_s: float | None = None,
) -> Alignment:
    """Returns the alignment of trials by their force alone.

    Args:
        series: R arrays [T_r, C], N, evenly sampled; lengths may differ.
        sample_rate_hz: of all trials, Hz.
        warp: warp after the shift.
        max_lag_s: largest lag looked for, s; default a quarter of the shortest trial.
        warp_radius_s: bound on the warp (Sakoe-Chiba), s; None for no bound.

    Raises:
        ValueError: no trial, fewer than 2 samples in one, values that are not finite, different channels, a
            sample rate that is not above 0, or trials that do not overlap.
    """
    arrays = _checked(series, sample_rate_hz)
    mean, deviation = _statistics(arrays)
    standard = [(a - m) / d for a, m, d in zip(arrays, mean, deviation, strict=True)]
    shortest = min(len(a) for a in arrays)
    most = shortest / 4 if max_lag_s is None else max_lag_s * sample_rate_hz
    lags = coarse_lags(standard, min(most, shortest - 2))
    start = max(0.0, float(np.max(-lags)))
    counts = [int(np.floor(len(a) - 1 - start - lag + 1e-9)) + 1 for a, lag in zip(arrays, lags, strict=True)]
    if min(counts) < 2:
        raise ValueError("the trials do not overlap after the shift; give a smaller max_lag_s")
    stamps = np.arange(max(counts), dtype=np.float64)
    sources = [np.where(stamps < n, stamps + start + g, np.nan) for n, g in zip(counts, lags, strict=True)]
    shifted = [interpolate(a, at)[:n] for a, at, n in zip(standard, sources, counts, strict=True)]
    distance = np.full((len(arrays), len(arrays)), np.nan)
    matches: list[Matches | None] = [None] * len(arrays)
    reference, size = 0, max(counts)
    if len(arrays) > 1 and warp:
        radius = None if warp_radius_s is None else round(warp_radius_s * sample_rate_hz)
        distance = dtw.distances(shifted, radius=radius)
        reference = medoid(distance)
        size = counts[reference]
        for r in set(range(len(arrays))) - {reference}:
            path = dtw.warp(shifted[r], shifted[reference], radius=radius)
            matches[r] = np.stack([path.query, path.reference], 1)
    placed = [interpolate(a, at) for a, at in zip(arrays, sources, strict=True)]
    return Alignment(
        variable="time",
        reason="asked for",
        time_s=np.arange(size) / sample_rate_hz,
        sources=tuple(sources),
        matches=tuple(matches),
        mean=mean,
        deviation=deviation,
        reference=reference,
        lag_s=(lags - lags[reference]) / sample_rate_hz,
        distance=distance,
        before=_plain_clock(arrays, size),
        shifted=np.stack([reindex(p, None, size) for p in placed]),
        after=np.stack([reindex(p, m, size) for p, m in zip(placed, matches, strict=True)]),
    )


def align_measured(
    series: Sequence[ArrayLike], coordinates: Sequence[ArrayLike], sample_rate_hz: float, variable: str
) -> Alignment:
    """Returns the alignment on a measured coordinate of each trial: nothing is estimated, nothing warped.

    Args:
        series: R arrays [T_r, C], N.
        coordinates: R arrays [T_r], strictly increasing, in one unit and from one origin.
        sample_rate_hz: Hz.
        variable: its name, for the report.

    Raises:
        ValueError: bad series (as `align`), a coordinate that does not increase, or trials that do not
            overlap.
    """
    arrays = _checked(series, sample_rate_hz)
    tracks = [np.asarray(c, np.float64) for c in coordinates]
    for r, (a, c) in enumerate(zip(arrays, tracks, strict=True)):
        if c.shape != (len(a),) or not np.isfinite(c).all() or np.any(np.diff(c) <= 0):
            raise ValueError(f"the {variable} of trial {r} is not one strictly increasing value a sample")
    rate = float(np.mean([(c[-1] - c[0]) / (len(c) - 1) for c in tracks]))  # per sample
    first, last = max(c[0] for c in tracks), max(c[-1] for c in tracks)
    if first >= min(c[-1] for c in tracks):
        raise ValueError(f"the trials do not overlap in {variable}; use those that do, or align in time")
    grid = np.arange(first, last, rate)
    sources = [np.interp(grid, c, np.arange(len(c)), right=np.nan) for c in tracks]
    mean, deviation = _statistics(arrays)
    placed = np.stack([interpolate(a, at) for a, at in zip(arrays, sources, strict=True)])
    return Alignment(
        variable=variable,
        reason="measured in all trials",
        time_s=np.arange(len(grid)) / sample_rate_hz,
        sources=tuple(sources),
        matches=(None,) * len(arrays),
        mean=mean,
        deviation=deviation,
        reference=-1,
        lag_s=np.array([np.interp(first, c, np.arange(len(c))) for c in tracks]) / sample_rate_hz,
        distance=np.full((len(arrays), len(arrays)), np.nan),
        before=_plain_clock(arrays, len(grid)),
        shifted=placed,
        after=placed,
    )


def medoid(distance: ArrayLike) -> int:
    """Returns the trial to which the others are nearest: the least mean of its column [R, R] (query by row).

    Raises:
        ValueError: every trial has one that cannot be warped to it within the radius.
    """
    cost = np.asarray(distance, np.float64).sum(0)
    if not np.isfinite(cost).any():
        raise ValueError("no trial can be warped to any reference within warp_radius_s; give a larger radius")
    return int(np.argmin(cost))


def _coordinates(trials: Sequence[Trial], name: str) -> tuple[list[Real] | None, str]:
    """Returns (the coordinate of every trial, "") or (None, why not)."""
    found = []
    for trial in trials:
        if name == "spindle_angle":
            if trial.spindle_angle_rad is None:
                return None, "not all trials measured the spindle angle"
            track = np.unwrap(trial.spindle_angle_rad)
            track = (track if track[-1] > track[0] else -track) - 0.0
            track = track - 2 * np.pi * np.floor(track[0] / (2 * np.pi))
        else:
            if trial.position_m is None:
                return None, "not all trials measured the position"
            travel = trial.position_m[-1] - trial.position_m[0]
            length = float(np.linalg.norm(travel))
            if length <= 0:
                return None, f"the position of {trial.file} does not move"
            track = trial.position_m @ (travel / length)
        forward = np.diff(track) > 0
        if forward.mean() < MEASURED_SHARE:
            return None, f"the {name.replace('_', ' ')} of {trial.file} does not increase steadily"
        rising = np.maximum.accumulate(track)
        found.append(rising + 1e-9 * (rising[-1] - rising[0]) * np.arange(len(rising)) / len(rising))
    return found, ""


def _checked(series: Sequence[ArrayLike], sample_rate_hz: float) -> list[Real]:
    arrays = [dtw.checked_series(s, f"trial {r}") for r, s in enumerate(series)]
    if not arrays or len({a.shape[1] for a in arrays}) > 1:
        raise ValueError(f"got {len(arrays)} trials; expected at least one, and the same channels in all")
    if not (np.isfinite(sample_rate_hz) and sample_rate_hz > 0):
        raise ValueError(f"got a sample rate of {sample_rate_hz} Hz; expected one above 0")
    return arrays


def _statistics(arrays: list[Real]) -> tuple[Real, Real]:
    mean, deviation = np.stack([a.mean(0) for a in arrays]), np.stack([a.std(0) for a in arrays])
    return mean, np.where(deviation > 0, deviation, 1.0)


def _plain_clock(arrays: list[Real], stamps: int) -> Real:
    return np.stack([reindex(a, None, stamps) for a in arrays])


def _spread(values: Real) -> float:
    everywhere = np.isfinite(values).all((0, 2))
    mean = values[:, everywhere].mean(0)
    apart = values[:, everywhere] - mean
    return float(
        np.sqrt(np.mean(apart**2)) / max(float(np.sqrt(np.mean((mean - mean.mean(0)) ** 2))), 1e-300)
    )
