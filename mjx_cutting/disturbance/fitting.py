"""From trials of residual force to a `DisturbanceGP`: scan, search, trial effects, posterior, diagnostics.

The whole fit runs in float64 inside `_platform.x64()` and is deterministic: no random starts.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjx_cutting import _platform
from mjx_cutting.disturbance import forecast, laplace, search, weights
from mjx_cutting.disturbance.artefact import plain
from mjx_cutting.disturbance.gp import AXES, DisturbanceGP
from mjx_cutting.disturbance.kernel import HARMONICS, fourier, prior, shortest_length
from mjx_cutting.disturbance.search import Found
from mjx_cutting.disturbance.statistics import Statistics, reduce, spread_noise

STARTS = 32
EFFECT_STARTS = 4
MOST_HARMONICS = 64
MIN_PERIODS = 2.0
LOOSE = 2.0  # times the residual: a new trial's band beyond that is not what the trials show
LEFT_TO_GAIN = 0.05  # nats: above it the search counts as unfinished


def fit(
    time_s: ArrayLike,
    residual_n: ArrayLike,
    *,
    axes: Sequence[str] | None = None,
    trial_effects: bool = True,
    harmonics: int = HARMONICS,
    frequency_range_hz: tuple[float, float] | None = None,
    starts: int = STARTS,
    noise_std_n: ArrayLike | None = None,
    quasi_periodic: bool = False,
    diagnose: bool = True,
    provenance: dict[str, Any] | None = None,
) -> DisturbanceGP:
    """Returns the periodic process that explains the trials' residual force best.

    Args:
        time_s: stamps [N], s, shared by the trials, increasing (an even grid is fastest and alone can be
            checked for aliasing).
        residual_n: measured minus model [R, N, A], N, in process axes; nan where a trial has no sample.
        axes: the names of the A axes out of "x", "y", "z"; default the first A.
        trial_effects: give each trial a process of its own beside the common one (needs two trials).
        harmonics: J; doubled once where the length comes out too short for it.
        frequency_range_hz: where to look for the frequency; default 2 / T to a twentieth of the sample rate.
        starts: how many peaks of the scan are searched from.
        noise_std_n: the sensor's noise [A] in free space, N: where to start; default from the trials.
        quasi_periodic: let the shape drift over the trial (a slow factor on the kernel); slower.
        diagnose: also compute held-out scores and residual tests (several seconds).
        provenance: what to keep in the artefact about where the trials came from.

    Raises:
        ValueError: bad shapes or values (see `statistics.reduce`), a record shorter than two periods of the
            range asked for, a range beyond half the sample rate, or no start that ends in finite numbers.
    """
    with _platform.x64():
        statistics = reduce(np.asarray(time_s), np.asarray(residual_n), trial_effects)
        names = _names(axes, statistics.axes)
        low, high = frequency_range(statistics, frequency_range_hz)
        noise = spread_noise(statistics)
        if noise_std_n is not None:
            noise = np.broadcast_to(np.asarray(noise_std_n, np.float64), noise.shape) / statistics.scale
            if not (np.isfinite(noise).all() and np.all(noise > 0)):
                raise ValueError(f"got noise_std_n {noise_std_n}; expected values above 0 N, one an axis")
        grid = search.frequency_grid(statistics, low, high)
        found, scanned = optimise(statistics, grid, noise, harmonics, starts)
        warnings = []
        if _too_short(found, harmonics, statistics) and harmonics < MOST_HARMONICS:
            harmonics = MOST_HARMONICS
            found, scanned = optimise(statistics, grid, noise, harmonics, starts)
        if _too_short(found, harmonics, statistics):
            warnings.append(
                f"the length is at its least value for {harmonics} harmonics "
                f"({shortest_length(harmonics):.3g}): "
                "the residual is rougher than this kernel can say. Look at the spectrum before use; a "
                "shorter band or a lower sample rate may be what you want"
            )
        errors = laplace.standard_errors(found, statistics, harmonics)
        if errors["gain_nats"] > LEFT_TO_GAIN:
            found = _polished(found, statistics, harmonics, starts, errors["unit"], low)
            errors = laplace.standard_errors(found, statistics, harmonics)
        del errors["unit"]
        if errors["gain_nats"] > LEFT_TO_GAIN:
            warnings.append(
                "the search stopped before its tolerance; the figures may be off. Give "
                "frequency_range_hz around "
                "the peak, or more samples"
            )
        gp = _assemble(statistics, found, harmonics, errors, names, grid, scanned)
        warnings += _frequency_warnings(gp, (low, high), statistics.nyquist_hz)
        if quasi_periodic:
            gp, warning = _drifting(gp, statistics, found)
            warnings += warning
        warnings += _loose_warnings(gp, statistics)
        if diagnose:
            from mjx_cutting.disturbance import diagnostics

            report = diagnostics.diagnose(gp, statistics, found)
            warnings += report.pop("warnings")
        else:
            report = {}
        return dataclasses.replace(
            gp, warnings=tuple(warnings), diagnostics=plain(report), provenance=plain(dict(provenance or {}))
        )


def frequency_range(statistics: Statistics, asked: tuple[float, float] | None) -> tuple[float, float]:
    """Returns the (low, high) frequencies [Hz] to look at, checked against the record's length and rate."""
    nyquist, least = 0.5 * statistics.sample_rate_hz, MIN_PERIODS / statistics.span_s
    if asked is None:
        low, high = least, min(max(statistics.sample_rate_hz / 20.0, 4.0 * least), nyquist)
    else:
        low, high = (float(f) for f in asked)
    if not (np.isfinite([low, high]).all() and 0 < low < high):
        raise ValueError(f"got a frequency range of {low} to {high} Hz; expected 0 < low < high")
    if low < least * (1 - 1e-9):
        raise ValueError(
            f"a period of {1 / low:.4g} s fits less than {MIN_PERIODS:g} times into the "
            f"{statistics.span_s:.4g} s "
            f"of the trials; ask for frequencies of at least {least:.4g} Hz or use longer trials"
        )
    if high > nyquist * (1 + 1e-9):
        raise ValueError(
            f"frequencies up to {high:.4g} Hz alias at a sample rate of {statistics.sample_rate_hz:.4g} Hz; "
            f"ask for at most {nyquist:.4g} Hz"
        )
    return low, high


def optimise(
    statistics: Statistics, grid: NDArray, noise: NDArray, harmonics: int, starts: int
) -> tuple[Found, NDArray[np.float64]]:
    """Returns (the optimum kept, the scan's log likelihood [F]); `noise` [A] in the scaled unit.

    Raises:
        ValueError: no start that ends in finite numbers.
    """
    pooled = statistics if statistics.effects == "pooled" else statistics.pooled()
    scanned = search.scan(pooled, grid, _pooled_noise(pooled, noise), harmonics)
    frequency, length = search.peaks(grid, scanned, starts)
    one = np.ones(statistics.axes)
    common = np.sqrt(np.maximum(1.0 - noise**2, 0.1))
    x0 = np.stack([search.encode(each * one, common, np.maximum(noise, 0.02), None) for each in length])
    curvature = search.scan_curvature(grid, scanned, frequency)
    found = search.minimise(pooled, x0, frequency, curvature, harmonics, grid[0])
    if statistics.effects != "pooled" and found:
        found = _with_effects(statistics, found, noise, harmonics, (grid, scanned))
    if not found:
        raise ValueError(
            "no start of the search ended in finite numbers; check the residual for outliers and its units, "
            "or give frequency_range_hz around the period you expect"
        )
    return forecast.choose(found, statistics, harmonics), np.max(scanned, axis=1)


def _polished(
    found: Found, statistics: Statistics, harmonics: int, starts: int, unit: list[float], low_hz: float
) -> Found:
    """Returns the optimum of another search from `found` in the variables that its own Hessian scales."""
    count = EFFECT_STARTS if statistics.effects != "pooled" else starts  # the size compiled already
    x0, f0 = np.tile(found.variables, (count, 1)), np.full(count, found.start_hz)
    again = search.minimise(
        statistics, x0, f0, np.ones(count), harmonics, low_hz, unit=np.minimum(np.asarray(unit), 1.0)
    )
    better = again and again[0].log_likelihood > found.log_likelihood
    return again[0] if better else found


def _with_effects(
    statistics: Statistics,
    pooled: list[Found],
    noise: NDArray,
    harmonics: int,
    scanned: tuple[NDArray, NDArray],
) -> list[Found]:
    x0, f0 = [], []
    for each in _distinct(pooled, statistics.span_s)[:EFFECT_STARTS]:
        h = each.hyper
        spread = np.sqrt(np.maximum(h.noise**2 - noise**2, (0.1 * h.noise) ** 2))
        x0.append(search.encode(h.length, np.maximum(h.amplitude, 0.05), noise, (h.length, spread)))
        f0.append(float(h.frequency_hz))
    while len(x0) < EFFECT_STARTS:  # one compiled size
        x0.append(x0[0] + 0.3)
        f0.append(f0[0])
    curvature = search.scan_curvature(*scanned, np.asarray(f0))
    return search.minimise(statistics, np.stack(x0), np.asarray(f0), curvature, harmonics, scanned[0][0])


def _distinct(found: list[Found], span_s: float) -> list[Found]:
    kept: list[Found] = []
    for each in found:
        f = float(each.hyper.frequency_hz)
        if all(abs(f - float(k.hyper.frequency_hz)) * span_s > 0.05 for k in kept):
            kept.append(each)
    return kept


def _pooled_noise(pooled: Statistics, noise: NDArray) -> NDArray[np.float64]:
    """The pooled model counts trial effects as noise: its scan takes the spread within stamps."""
    seen = np.all(np.isfinite(pooled.residual), axis=-1)
    many = seen.sum(0) > 1
    if not many.any():
        return noise
    some = pooled.residual[:, many]
    within = np.nansum((some - np.nanmean(some, axis=0)) ** 2, axis=(0, 1)) / np.sum(seen[:, many].sum(0) - 1)
    return np.maximum(noise, np.sqrt(within))


def _too_short(found: Found, harmonics: int, statistics: Statistics) -> bool:
    """Whether a length that matters sits at the bound below which the kernel's tail would be refused (no
    matter where the last harmonics lie above half the sample rate and are left out anyway)."""
    if search.visible_harmonics(found.start_hz, statistics.nyquist_hz, harmonics) < harmonics:
        return False
    bound, h = 1.1 * shortest_length(harmonics), found.hyper
    matters = h.amplitude > 0.2 * h.noise
    own = h.trial_amplitude > 0.2 * h.noise
    return bool(np.any((h.length < bound) & matters) or np.any((h.trial_length < bound) & own))


def _names(axes: Sequence[str] | None, count: int) -> tuple[str, ...]:
    names = tuple(AXES[:count] if axes is None else axes)
    if len(names) != count or len(set(names)) != count or not set(names) <= set(AXES):
        raise ValueError(
            f"got axes {names} for {count} column(s) of residual; expected distinct names out of {AXES}"
        )
    return names


def _assemble(
    statistics: Statistics,
    found: Found,
    harmonics: int,
    errors: dict[str, Any],
    names: tuple[str, ...],
    grid: NDArray,
    scanned: NDArray,
) -> DisturbanceGP:
    h, scale = found.hyper, statistics.scale
    effects = statistics.effects != "pooled"
    features = fourier(statistics.time_s, float(h.frequency_hz), harmonics)
    seen = search.visible_harmonics(found.start_hz, statistics.nyquist_hz, harmonics)
    priors = search.prior_variances(h, harmonics, seen, statistics.largest_constant)
    posterior = weights.condition(features, statistics.residual, priors, h.noise, effects)
    common, own = _deviations(priors, harmonics)
    return DisturbanceGP(
        axes=names,
        frequency_hz=float(h.frequency_hz),
        length=h.length,
        amplitude_n=h.amplitude * scale,
        trial_length=h.trial_length,
        trial_amplitude_n=h.trial_amplitude * scale,
        noise_std_n=h.noise * scale,
        common_std_n=common * scale,
        trial_std_n=own * scale,
        harmonics=harmonics,
        weights_mean_n=posterior.mean * scale[:, None],
        weights_factor_n=posterior.factor * scale[:, None, None],
        weights_trial_factor_n=posterior.trial_factor * scale[:, None, None],
        trial_means_n=posterior.trial_means * scale[:, None],
        standard_errors=errors,
        log_likelihood=found.log_likelihood - statistics.count * float(np.sum(np.log(scale))),
        trial_effects=effects,
        trials=statistics.trials,
        samples=statistics.count,
        start_s=float(statistics.time_s[0]),
        span_s=statistics.span_s,
        sample_rate_hz=statistics.sample_rate_hz,
        scan_hz=np.asarray(grid),
        scan_log_likelihood=scanned,
    )


def _deviations(priors: tuple[NDArray, NDArray], harmonics: int) -> tuple[NDArray, NDArray]:
    """Returns the deviations [A], [A] of both processes at any one time, from diag S_0 and diag S_1."""
    common, own = (np.sqrt(each[:, : harmonics + 1].sum(1)) for each in priors)
    return common, own


def _loose_warnings(gp: DisturbanceGP, statistics: Statistics) -> list[str]:
    """Warns of an axis on which a new trial's band is far wider than the trials themselves."""
    _, deviation = gp.predict(statistics.time_s)
    band = np.sqrt(np.mean(deviation**2, 0))
    size = statistics.scale * np.sqrt(np.nanmean(statistics.residual**2, (0, 1)))
    return [
        f"on axis {name} a new trial's standard deviation is {b:.3g} N where the trials themselves are "
        f"{s:.3g} N (root mean square): they do not fix how much trials differ. Use more trials, or fit them "
        "as one process (trial_effects=False)"
        for name, b, s in zip(gp.axes, band, size, strict=True)
        if b > LOOSE * s
    ]


def _drifting(gp: DisturbanceGP, statistics: Statistics, found: Found) -> tuple[DisturbanceGP, list[str]]:
    """Returns the process with a slow factor, started from the periodic one."""
    from mjx_cutting.disturbance import quasiperiodic

    harmonics = min(max(4, gp.kept_harmonics()), 12)
    drift = quasiperiodic.optimise(statistics, found, harmonics, shortest_length(gp.harmonics))
    h, scale, nodes = drift.hyper, statistics.scale, drift.nodes_s
    phi = quasiperiodic.features(
        statistics.time_s, float(h.frequency_hz), harmonics, nodes, drift.slow_length_s
    )
    seen = search.visible_harmonics(found.start_hz, statistics.nyquist_hz, harmonics)
    common, own = search.prior_variances(h, harmonics, seen, statistics.largest_constant)
    first, second = _deviations((common, own), harmonics)
    priors = (np.repeat(common, len(nodes), axis=1), np.repeat(own, len(nodes), axis=1))
    posterior = weights.condition(phi, statistics.residual, priors, h.noise, gp.trial_effects)
    drifted = dataclasses.replace(
        gp,
        frequency_hz=float(h.frequency_hz),
        length=h.length,
        amplitude_n=h.amplitude * scale,
        trial_length=h.trial_length,
        trial_amplitude_n=h.trial_amplitude * scale,
        noise_std_n=h.noise * scale,
        common_std_n=first * scale,
        trial_std_n=second * scale,
        harmonics=harmonics,
        weights_mean_n=posterior.mean * scale[:, None],
        weights_factor_n=posterior.factor * scale[:, None, None],
        weights_trial_factor_n=posterior.trial_factor * scale[:, None, None],
        trial_means_n=posterior.trial_means * scale[:, None],
        log_likelihood=drift.log_likelihood - statistics.count * float(np.sum(np.log(scale))),
        slow_nodes_s=nodes,
        slow_length_s=drift.slow_length_s,
    )
    warnings = []
    if drift.slow_length_s < 1.5 * quasiperiodic.LEAST_SLOW * statistics.span_s:
        warnings.append(
            f"the shape drifts within {drift.slow_length_s:.3g} s, as fast as this option allows: the "
            "residual is hardly "
            "periodic. Use longer trials or look for another cause"
        )
    if gp.log_likelihood > drifted.log_likelihood - 2.0:
        warnings.append(
            f"letting the shape drift gains {drifted.log_likelihood - gp.log_likelihood:.1f} nats only: "
            "the plain "
            "periodic process says the same and is cheaper to draw"
        )
    return drifted, warnings


def _frequency_warnings(gp: DisturbanceGP, looked: tuple[float, float], nyquist_hz: float) -> list[str]:
    found, edge = [], 1.0 / gp.span_s
    if gp.frequency_hz - looked[0] < edge or looked[1] - gp.frequency_hz < edge:
        found.append(
            f"the frequency found, {gp.frequency_hz:.4g} Hz, is at the edge of the range looked at "
            f"({looked[0]:.4g} to {looked[1]:.4g} Hz); widen frequency_range_hz or use longer trials"
        )
    seen = search.visible_harmonics(gp.frequency_hz, nyquist_hz, gp.harmonics)
    orders = np.r_[0, np.tile(np.arange(1, gp.harmonics + 1), 2)]
    own = gp.trial_amplitude_n > gp.amplitude_n
    lengths = np.where(own, gp.trial_length, gp.length)
    lost = max(float(prior(l, gp.harmonics)[orders > seen].sum()) for l in lengths)
    if lost > 0.01:
        found.append(
            f"only {seen} harmonics of {gp.frequency_hz:.4g} Hz lie below half the sample rate; the "
            "fitted shape "
            f"would have {100 * lost:.0f} % of its variance above, where nothing was measured: draws "
            "leave it out"
        )
    return found
