"""What a user can judge the fit by: held-out scores, calibration, what is left, and whether it is periodic.

Trials are the units. Each fold leaves trials out, searches the hyperparameters anew from the full fit's
optimum, and scores the left-out trials as new ones: joint negative log predictive density per sample,
coverage at 1 and 2 sigma, probability integral transform (flat when calibrated). With one trial its last
third is held out instead. Observation coverage can look right while the latent process is far too sure of
itself (noise hides it), so read the joint density as well.

Periodicity is tested by what it promises: from two thirds of all trials the process foretells the rest of
each. `periodic_share` is the share of that third's energy it explains; Ljung-Box tests what is left. Coloured
noise makes the period's standard error too small and can pass for a trial effect: its lag-1 autocorrelation
is given.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, signal, stats

from mjx_cutting.disturbance import forecast, search, weights
from mjx_cutting.disturbance.kernel import fourier
from mjx_cutting.disturbance.laplace import inflation
from mjx_cutting.disturbance.likelihood import Hyper
from mjx_cutting.disturbance.search import Found
from mjx_cutting.disturbance.statistics import Statistics

FOLDS = 14
REFIT_STEPS = 25
LAGS = 20
PIT_BINS = 20
NOT_PERIODIC = 0.05  # share of a trial's energy below which nothing periodic is claimed
COLOURED = 0.1  # autocorrelation of what is left above which it is not independent noise

Real = NDArray[np.float64]


def diagnose(gp: Any, statistics: Statistics, found: Found) -> dict[str, Any]:
    """Returns the diagnostics as plain lists and numbers, with "verdict" and "warnings".

    Args:
        gp: the `DisturbanceGP` fitted to all trials.
        statistics: the trials.
        found: the optimum of the search.
    """
    left = statistics.residual * statistics.scale - gp.trial_mean(statistics.time_s)
    correlation = autocorrelation(left)
    report: dict[str, Any] = {
        "heldout": held_out(statistics, found, gp.harmonics),
        "explained": explained(gp, statistics),
        "left_autocorrelation": correlation.T.tolist(),
        "left_lag1": correlation[0].tolist(),
        "ljung_box": {
            "lags": LAGS,
            "data": ljung_box(statistics.residual),
            "left": ljung_box(left),
        },
        "spectrum": spectrum(gp, statistics),
    }
    worst = float(np.max(correlation[0]))
    error = gp.standard_errors["period_s"]
    report["period_std_if_coloured_s"] = error * inflation(worst)
    report["verdict"], report["warnings"] = _verdict(report, correlation, gp)
    return report


def held_out(statistics: Statistics, found: Found, harmonics: int) -> dict[str, Any]:
    """Returns the scores of trials left out (or, with one trial, of its last third)."""
    z, log_density, plain, samples, folds = [], 0.0, 0.0, 0, 0
    for train, test in _splits(statistics):
        folds += 1
        refit = _refit(train, found, harmonics)
        posterior = _condition(train, refit, harmonics)
        phi = fourier(test.time_s, float(refit.hyper.frequency_hz), harmonics)
        for a in range(statistics.axes):
            sigma = float(refit.hyper.noise[a])
            factor = posterior.trial_factor[a]
            mean, spread = phi @ posterior.mean[a], np.sum((phi @ factor) ** 2, 1) + sigma**2
            constant = train.residual[..., a][np.isfinite(train.residual[..., a])]
            for y in test.residual[..., a]:
                seen = np.isfinite(y)
                r = y[seen] - mean[seen]
                z.append(r / np.sqrt(spread[seen]))
                log_density += _joint(r, phi[seen] @ factor, sigma)
                plain += np.sum(stats.norm.logpdf(y[seen], constant.mean(), constant.std()))
                samples += len(r)
    scored = np.concatenate(z)
    log_scale = float(np.mean(np.log(statistics.scale)))
    return {
        "how": "trials left out" if statistics.trials > 1 else "last third of the only trial left out",
        "folds": folds,
        "nlpd_nats_per_sample": -log_density / samples + log_scale,
        "nlpd_of_white_noise": -plain / samples + log_scale,
        "coverage_1_sigma": float(np.mean(np.abs(scored) < 1)),
        "coverage_2_sigma": float(np.mean(np.abs(scored) < 2)),
        "pit_counts": np.histogram(stats.norm.cdf(scored), bins=PIT_BINS, range=(0, 1))[0].tolist(),
    }


def explained(gp: Any, statistics: Statistics) -> dict[str, Any]:
    """Returns shares of energy by axis and in all: of the mean process, and of the periodicity test."""
    phi, scale = gp.features(statistics.time_s), statistics.scale
    everywhere = np.all(np.isfinite(statistics.residual), axis=-1)
    common = np.broadcast_to(phi @ gp.weights_mean_n.T / scale, statistics.residual.shape)
    hyper = Hyper(
        gp.frequency_hz,
        gp.length,
        gp.amplitude_n / scale,
        gp.trial_length,
        gp.trial_amplitude_n / scale,
        gp.noise_std_n / scale,
    )
    visible = search.visible_harmonics(gp.frequency_hz, statistics.nyquist_hz, gp.harmonics)
    repeats = max(1, len(gp.slow_nodes_s))
    both = search.prior_variances(hyper, gp.harmonics, visible, statistics.largest_constant)
    first, second = (np.repeat(p, repeats, axis=1) for p in both)
    ahead = forecast.foretold(statistics, phi, (first, second), hyper.noise)
    shares = {
        "common": forecast.share(statistics, common, everywhere),
        "with_own": forecast.share(statistics, gp.trial_mean(statistics.time_s) / scale, everywhere),
        "periodic_share": forecast.share(statistics, ahead, forecast.last_third(statistics)),
    }
    return {name: {"by_axis": by_axis.tolist(), "all": whole} for name, (by_axis, whole) in shares.items()}


def autocorrelation(left: Real, lags: int = LAGS) -> Real:
    """Returns the autocorrelation [lags, A] of [R, N, A] at lags 1 .. `lags`, trials pooled, nan skipped."""
    centred = left - np.nanmean(left, axis=1, keepdims=True)
    variance = np.nanmean(centred**2, axis=(0, 1))
    lags = min(lags, left.shape[1] - 1)
    found = [np.nanmean(centred[:, k:] * centred[:, :-k], axis=(0, 1)) / variance for k in range(1, lags + 1)]
    return np.stack(found)


def ljung_box(values: Real, lags: int = LAGS) -> dict[str, Any]:
    """Returns the Ljung-Box statistic by axis, summed over trials [R, N, A], its degrees of freedom and p."""
    total, freedom = np.zeros(values.shape[2]), 0
    for trial in values:
        kept = trial[np.isfinite(trial).all(-1)]
        n = len(kept)
        if n <= lags + 1:
            continue
        rho = autocorrelation(kept[None], lags)
        total += n * (n + 2) * np.sum(rho**2 / (n - np.arange(1, lags + 1))[:, None], 0)
        freedom += lags
    p = stats.chi2.sf(total, max(freedom, 1))
    return {"statistic": total.tolist(), "degrees_of_freedom": freedom, "p": p.tolist()}


def spectrum(gp: Any, statistics: Statistics) -> dict[str, Any]:
    """Returns power spectral densities [F] by axis, N^2/Hz, of the data, of the fit and of what is left."""
    y = statistics.residual * statistics.scale
    fitted = gp.trial_mean(statistics.time_s)
    segment = int(min(512, statistics.residual.shape[1]))
    frequency: Real = np.zeros(0)
    found: dict[str, list] = {"data": [], "fit": [], "left": []}
    for a in range(statistics.axes):
        sums: dict[str, list] = {name: [] for name in found}
        for trial, fit in zip(y[..., a], fitted[..., a], strict=True):
            seen = np.isfinite(trial)
            if seen.sum() < segment:
                continue
            parts = {"data": trial[seen], "fit": fit[seen], "left": trial[seen] - fit[seen]}
            for name, part in parts.items():
                frequency, power = signal.welch(part, statistics.sample_rate_hz, nperseg=segment)
                sums[name].append(power)
        for name in found:
            found[name].append(np.mean(sums[name], 0).tolist() if sums[name] else [])
    return {"frequency_hz": frequency.tolist(), **found}


def _verdict(report: dict[str, Any], correlation: Real, gp: Any) -> tuple[str, list[str]]:
    share = report["explained"]["periodic_share"]["all"]
    coloured = float(np.max(np.abs(correlation)))
    warnings = []
    if coloured > COLOURED:
        warnings.append(
            f"what is left is not independent noise (autocorrelation up to {coloured:.2f}): the period's "
            "standard error is "
            f"then nearer {report['period_std_if_coloured_s']:.2g} s than "
            f"{gp.standard_errors['period_s']:.2g} s, and part of "
            "the trial effect may be noise. Draws lack that part"
        )
    if share < NOT_PERIODIC:
        warnings.insert(
            0,
            "this residual is not periodic: from two thirds of a trial the process foretells "
            f"{100 * max(share, 0):.0f} % of the "
            "last third's energy. Do not use its draws as a model of the disturbance; look at the "
            "spectrum and "
            "trace the residual for another cause",
        )
        return "not periodic", warnings
    return ("periodic" if coloured <= COLOURED else "partly periodic"), warnings


def _splits(statistics: Statistics) -> Iterator[tuple[Statistics, Statistics]]:
    """Yields (train, test); all training sets are of one size, so that the search compiles once."""
    trials = statistics.trials
    if trials == 1:
        last = forecast.last_third(statistics)[0]
        yield _cut(statistics, ~last), _cut(statistics, last)
        return
    size = -(-trials // FOLDS)
    for k in range(trials // size):
        test = np.arange(k * size, (k + 1) * size)
        yield statistics.subset(np.setdiff1d(np.arange(trials), test)), statistics.subset(test)


def _cut(statistics: Statistics, keep: NDArray) -> Statistics:
    from mjx_cutting.disturbance.statistics import _reduce

    time, residual = statistics.time_s[keep], statistics.residual[:, keep]
    return _reduce(time, residual, statistics.scale, False)


def _refit(train: Statistics, found: Found, harmonics: int) -> Found:
    """The optimum for the training trials from the full one (pooled where only one trial is left)."""
    x = found.variables
    axes = train.axes
    if train.effects == "pooled" and len(x) == 1 + 5 * axes:
        x = np.concatenate([x[: 1 + 2 * axes], x[1 + 4 * axes :]])
    start = np.asarray([float(found.hyper.frequency_hz)])
    x = np.concatenate([[0.0], x[1:]])
    curvature = np.asarray([train.count / 6.0])  # of a cosine half of whose energy is noise
    least = float(start[0]) - found.reach_hz
    refit = search.minimise(train, x[None], start, curvature, harmonics, least, REFIT_STEPS)
    if refit:
        return refit[0]
    return dataclasses.replace(found, variables=x)


def _condition(train: Statistics, found: Found, harmonics: int) -> weights.Weights:
    h = found.hyper
    phi = fourier(train.time_s, float(h.frequency_hz), harmonics)
    seen = search.visible_harmonics(found.start_hz, train.nyquist_hz, harmonics)
    priors = search.prior_variances(h, harmonics, seen, train.largest_constant)
    return weights.condition(phi, train.residual, priors, h.noise, train.effects != "pooled")


def _joint(r: Real, B: Real, sigma: float) -> float:
    """log N(r; 0, B B' + sigma^2 I)."""
    A = np.eye(B.shape[1]) + B.T @ B / sigma**2
    factor = linalg.cholesky(A, lower=True)
    inner = linalg.solve_triangular(factor, B.T @ r, lower=True) / sigma**2
    quadratic = r @ r / sigma**2 - inner @ inner
    return float(
        -0.5 * quadratic - np.sum(np.log(np.diag(factor))) - 0.5 * len(r) * np.log(2 * np.pi * sigma**2)
    )
