"""From measured trials and a force model to the disturbance's artefact: what `mjx-cutting fit-gp` does.

    predict -> measured minus predicted -> align -> thin to the band -> fit -> gp.npz, disturbance.json,
    figures

With a model each trial is predicted with its own phase, speed and bias, and the spindle angle so found is the
clock ("angle"): nothing is estimated again. Without that ("time") the trials are shifted and, if asked for,
warped on the measured force, the same shift and warp being applied to the residual; the period is then fitted
before the warp as well, because a warp distorts it. Without a model the measured force itself, less each
trial's mean, is taken. A record whose band ends far below half its sample rate is thinned to about twice that
band: samples in between say nothing new and would make the noise look coloured.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mjx_cutting import _files
from mjx_cutting.cutting import ForceModel
from mjx_cutting.disturbance import DisturbanceGP, fit
from mjx_cutting.disturbance.artefact import plain
from mjx_cutting.tracing import predict_trials
from mjx_cutting.tracing.records.lines import trusted_band
from mjx_cutting.trials.align import Alignment, align, align_measured, align_trials
from mjx_cutting.trials.dataset import Dataset
from mjx_cutting.trials.dropouts import without_dropouts
from mjx_cutting.trials.spikes import without_spikes

OVERSAMPLED = 2.0  # samples a second per hertz of the band after thinning
PAST_SPINDLE = 1.2  # how far beyond the spindle's speed a fundamental is looked for on its angle's clock
FOLDED = 32  # bins of the spindle angle to a tooth
TEETH_ALIKE = (
    0.05  # relative difference of a prediction from itself one tooth on, below which its teeth are alike
)
Clock = Literal["auto", "angle", "time"]
Real = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Fitted:
    """A fitted disturbance with what it was fitted to.

    Fields:
        gp: the process, with its diagnostics and warnings.
        alignment: how the trials were brought onto one clock.
        time_s: [N] s; residual_n: [R, N, A] N: the aligned trials that were fitted.
        report: plain facts, as in disturbance.json.
    """

    gp: DisturbanceGP
    alignment: Alignment
    time_s: Real
    residual_n: Real
    report: dict[str, Any]


def fit_gp(
    dataset: Dataset,
    model: ForceModel | None = None,
    out: str | Path | None = None,
    *,
    band_hz: tuple[float, float] | None = None,
    clock: Clock = "auto",
    warp: bool = False,
    max_lag_s: float | None = None,
    warp_radius_s: float | None = None,
    frequency_range_hz: tuple[float, float] | None = None,
    trial_effects: bool = True,
    quasi_periodic: bool = False,
    diagnose: bool = True,
    figures: bool = True,
    progress: Callable[[str], None] | None = None,
    provenance: dict[str, Any] | None = None,
) -> Fitted:
    """Returns the disturbance fitted to what `model` leaves of a dataset's cuts, without spikes and gaps.

    Args:
        dataset: measured trials.
        model: force model; None: the measured force itself is fitted.
        out: folder for gp.npz, disturbance.json and the figures; None: nothing is written.
        band_hz: band compared, Hz; default the anti-alias filter's corner or half the sampling rate.
        clock: "angle" (needs a model or a measured spindle angle), "time", or "auto": angle where it is
            known.
        warp, max_lag_s, warp_radius_s: as in `trials.align.align`, for the clock "time" alone.
        frequency_range_hz, trial_effects, quasi_periodic, diagnose: as in `disturbance.fit`.
        figures: write the figures too.
        progress: told the name of each stage.
        provenance: kept in the artefact beside the dataset's name, source and licence.

    Raises:
        ValueError: no cut trial, options of the other clock, trials that do not overlap, a record shorter
            than two periods, frequencies that alias, or a residual that is not finite.
    """
    told = progress or (lambda _: None)
    dataset, filled = without_dropouts(dataset)
    dataset, replaced = without_spikes(dataset)
    cuts = tuple(trial for trial in dataset.trials if trial.kind == "cut")
    if not cuts:
        raise ValueError(f"dataset {dataset.name!r} has no cut trial; fit-gp needs at least one")
    if clock not in ("auto", "angle", "time"):
        raise ValueError(f"got clock {clock!r}; expected 'auto', 'angle' or 'time'")
    rate = dataset.sensor.sample_rate_hz
    report: dict[str, Any] = {}
    speed = None
    told("predicting the trials" if model is not None else "reading the trials")
    if model is None:
        measured = [trial.force_n - trial.force_n.mean(0) for trial in cuts]
        left, angles = measured, None
    else:
        predictions = predict_trials(dataset, model, band_hz)
        measured = [each.measured_n for each in predictions]
        left, angles = [each.residual_n for each in predictions], [each.angle_rad for each in predictions]
        predicted = [each.predicted_n for each in predictions]
    told("aligning the trials")
    finite = np.all([np.isfinite(each).all(0) for each in left], axis=0)
    measured, left = [m[:, finite] for m in measured], [each[:, finite] for each in left]
    axes = tuple(np.array(["x", "y", "z"])[finite])
    if clock != "time" and angles is not None:
        _no_time_options(warp, max_lag_s, warp_radius_s)
        shifts = whole_teeth(angles, predicted, left, dataset.tool.teeth)
        angles = [
            angle + 2.0 * np.pi * k / dataset.tool.teeth for angle, k in zip(angles, shifts, strict=True)
        ]
        angles = [angle - 2.0 * np.pi * np.floor(angle[0] / (2.0 * np.pi)) for angle in angles]
        alignment = align_measured(measured, angles, rate, "spindle_angle")
        alignment = dataclasses.replace(alignment, reason="fitted to each trial by the prediction")
        report["teeth_shifted"] = shifts
        speed = float(np.mean([each.speed_rev_s for each in predictions]))
    elif clock == "time":
        alignment = align(measured, rate, warp=warp, max_lag_s=max_lag_s, warp_radius_s=warp_radius_s)
    else:
        options: dict[str, Any] = {"max_lag_s": max_lag_s, "warp_radius_s": warp_radius_s, "warp": warp}
        wanted = "spindle_angle" if clock == "angle" else "auto"
        alignment = align_trials(cuts, rate, variable=wanted, **options)
    stride = _stride(rate, trusted_band(dataset, band_hz)[1]) if model is not None else 1
    time_s = alignment.time_s[::stride]
    residual_n = alignment.apply(left)[:, ::stride]
    if frequency_range_hz is None and speed is not None:
        frequency_range_hz = _around_spindle(time_s, speed)
    told("fitting the disturbance")
    options = {
        "axes": axes,
        "frequency_range_hz": frequency_range_hz,
        "trial_effects": trial_effects,
        "quasi_periodic": quasi_periodic,
    }
    report |= {
        "alignment": alignment.report(),
        "energy_share": _share(left, measured),
        "thinned_by": stride,
        "dataset_warnings": [*dataset.warnings, *filled, *replaced],
        "left_out": [f"{each.file}: {each.reason}" for each in dataset.left_out],
    }
    if any(match is not None for match in alignment.matches):
        plain_n = alignment.apply(left, warp=False)[:, ::stride]
        before = fit(time_s, plain_n, **{**options, "quasi_periodic": False}, diagnose=False)
        report["fitted_period_before_warp_s"] = before.period_s
    kept = {
        "dataset": dataset.name,
        "source": dataset.source,
        "licence": dataset.licence,
        "trials": [trial.file for trial in cuts],
        "model": None if model is None else model.to_dict(),
        "band_hz": band_hz,
    }
    gp = fit(time_s, residual_n, **options, diagnose=diagnose, provenance=kept | report | (provenance or {}))
    report |= facts(gp)
    fitted = Fitted(gp, alignment, time_s, residual_n, report)
    if out is not None:
        told("writing")
        write(fitted, out, figures=figures)
    return fitted


def write(fitted: Fitted, out: str | Path, *, figures: bool = True) -> Path:
    """Returns gp.npz in the folder `out`, written beside disturbance.json and, if asked for, the figures.

    Raises:
        OSError: the folder cannot be written.
    """
    folder = Path(out)
    path = fitted.gp.save(folder / "gp.npz")
    _files.write_atomic(folder / "disturbance.json", json.dumps(plain(fitted.report), indent=2) + "\n")
    if figures:
        from mjx_cutting.disturbance.figures import save_all
        from mjx_cutting.trials import align_figure

        align_figure.save(fitted.alignment, folder / "alignment.png", fitted.gp.axes)
        save_all(fitted.gp, fitted.time_s, fitted.residual_n, folder)
    return path


def facts(gp: DisturbanceGP) -> dict[str, Any]:
    """Returns the hyperparameters, their errors, diagnostics and warnings of a process, in plain numbers."""
    names = (
        "axes",
        "frequency_hz",
        "period_s",
        "length",
        "amplitude_n",
        "trial_length",
        "trial_amplitude_n",
        "noise_std_n",
        "common_std_n",
        "trial_std_n",
        "slow_length_s",
        "harmonics",
        "standard_errors",
        "log_likelihood",
        "trials",
        "samples",
        "span_s",
        "warnings",
        "diagnostics",
    )
    found: dict[str, Any] = plain({name: getattr(gp, name) for name in names})
    return found


def whole_teeth(angles: list[Real], predicted: list[Real], left: list[Real], teeth: int) -> list[int]:
    """Returns by how many teeth to turn each trial's angle so that the residuals are most alike.

    A prediction whose teeth are all alike fixes the angle up to whole teeth only; what it leaves (runout,
    say) then starts from another tooth in each trial. Where the prediction tells its teeth apart nothing is
    turned.

    Args:
        angles: [T_r] rad; predicted, left: [T_r, A] N, of each trial.
        teeth: of the tool.
    """
    bins = FOLDED * teeth
    if teeth < 2 or any(
        _tells_teeth_apart(_fold(a, p, bins), teeth) for a, p in zip(angles, predicted, strict=True)
    ):
        return [0] * len(angles)
    folded = [_fold(a, e, bins) for a, e in zip(angles, left, strict=True)]
    first = int(np.argmax([np.sum(f**2) for f in folded]))
    total, shifts = folded[first].copy(), [0] * len(angles)
    for r in set(range(len(angles))) - {first}:
        turned = [np.roll(folded[r], k * FOLDED, axis=0) for k in range(teeth)]
        shifts[r] = int(np.argmax([np.sum(total * each) for each in turned]))
        total += turned[shifts[r]]
    return shifts


def _fold(angle: Real, values: Real, bins: int) -> Real:
    """Returns [bins, A]: the mean of `values` by spindle angle over one turn (0 in a bin that is empty)."""
    where = np.floor(np.mod(angle, 2.0 * np.pi) / (2.0 * np.pi) * bins).astype(int) % bins
    count = np.bincount(where, minlength=bins)
    sums = [np.bincount(where, values[:, a], minlength=bins) for a in range(values.shape[1])]
    return np.stack(sums, 1) / np.maximum(count, 1)[:, None]


def _tells_teeth_apart(folded: Real, teeth: int) -> bool:
    centred = folded - folded.mean(0)
    apart = centred - np.roll(centred, FOLDED, axis=0)
    return float(np.sum(apart**2)) > TEETH_ALIKE**2 * 2.0 * float(np.sum(centred**2))


def _around_spindle(time_s: Real, speed_rev_s: float) -> tuple[float, float] | None:
    """Returns where to look on the angle's clock: from two periods in the record to just past the spindle."""
    span, rate = time_s[-1] - time_s[0], 1.0 / (time_s[1] - time_s[0])
    low, high = 2.0 / span, min(PAST_SPINDLE * speed_rev_s, 0.5 * rate)
    return (low, high) if low < high else None


def _no_time_options(warp: bool, max_lag_s: float | None, warp_radius_s: float | None) -> None:
    if warp or max_lag_s is not None or warp_radius_s is not None:
        raise ValueError(
            "got a warp or a lag with the spindle angle as the clock, where nothing is left to estimate; "
            "leave "
            "them out, or ask for clock 'time'"
        )


def _stride(rate_hz: float, band_high_hz: float) -> int:
    return max(1, int(rate_hz / (OVERSAMPLED * band_high_hz)))


def _share(left: list[Real], measured: list[Real]) -> float:
    energy = sum(float(np.sum(each**2)) for each in measured)
    return sum(float(np.sum(each**2)) for each in left) / max(energy, 1e-300)
