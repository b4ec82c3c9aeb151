"""What makes a trial unusable, and what makes it doubtful.

The idea: each check looks at one property of a trial and answers with a sentence that says what was got, what
was expected and how to mend it. A reason leaves the trial out; a warning does not. Every reason of a trial is
listed, so one repair round is enough.

Tolerances are the constants below, with their grounds. The assumption that breaks them: conditions within
common machining practice; a record outside them is left out and named, never silently used.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.trials.dataset import Array, Dataset, LeftOut, Sensor, ToolInfo, Trial
from mjx_cutting.trials.dropouts import find_dropouts
from mjx_cutting.trials.idle import idle_cuts
from mjx_cutting.trials.saturation import find_saturation
from mjx_cutting.trials.spikes import trial_spikes
from mjx_cutting.trials.standstill import find_standstill

Channels = list[tuple[str, Array]]

SHORTEST_RECORD = 8
"""Samples below which nothing can be judged."""

FEWEST_REVOLUTIONS = 2.0
"""Below two revolutions a once-per-revolution line cannot be told from the mean."""

UNEVEN_TOLERANCE = 0.1
"""Largest deviation of a sampling interval from the median one, as a share of it (rounded time stamps: one
unit of rounding).
"""

RATE_TOLERANCE = 0.01
"""Largest share by which the time column's rate may differ from sensor.sample_rate_hz."""

SPEED_TOLERANCE = 0.02
"""Measured mean speed against the nominal one, which is taken to be good to 1 %; droop takes 1 to 10 %."""

LARGEST_FEED_PER_TOOTH_M = 2e-3
SMALLEST_FEED_PER_TOOTH_M = 1e-8
"""Feed per tooth [m]: above 2 mm or below 10 nm no cutter works; a unit is wrong (mm/min or mm/s given as
m/s).
"""

LARGEST_CUTTING_SPEED_M_S = 100.0
"""Rim speed [m/s]: above 6,000 m/min only special machines work; rev/min given as rev/s is the usual
cause.
"""

LARGEST_WIDTH_DIAMETERS = 20.0
"""Axial width over diameter; above this millimetres were given as metres."""

HARMONICS = 3
"""Harmonics of tooth passing looked at for aliasing to near DC."""


@dataclass(frozen=True)
class Verdict:
    """What the checks say of one trial: reasons to leave it out, and warnings."""

    reasons: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def check_trial(trial: Trial, tool: ToolInfo, sensor: Sensor, axes: Sequence[str] | None = None) -> Verdict:
    """The verdict on one trial; axes (as in `Dataset`) serve to name the file's columns in what is said."""
    channels = trial.columns(axes)
    reasons, warnings = _check_conditions(trial, tool)
    unreadable = _check_values(trial, channels)
    reasons += unreadable
    if not unreadable:
        time_reasons = _check_time(trial, sensor)
        reasons += time_reasons
        reasons += _check_saturation(channels)
        if trial.kind == "cut":
            reasons += _check_standstill(trial, channels)
        if not time_reasons:
            warnings += _check_aliasing(trial, tool, sensor)
            warnings += _check_measured_speed(trial)
            warnings += _check_dropouts(trial, find_dropouts(trial, axes))
            warnings += _check_spikes(trial, channels, trial_spikes(trial, axes))
        warnings += _check_constant(channels)
    return Verdict(tuple(reasons), tuple(warnings))


def finish(dataset: Dataset, outcomes: Iterable[tuple[Trial | LeftOut, Verdict]], *, where: str) -> Dataset:
    """The dataset with the good trials in, the bad ones named in left_out, warnings prefixed with their file.

    Raises ValueError where no good trial is left.
    """
    trials: list[Trial] = []
    left_out = list(dataset.left_out)
    warnings = list(dataset.warnings)
    for outcome, verdict in outcomes:
        if isinstance(outcome, LeftOut):
            left_out.append(outcome)
        elif verdict.reasons:
            left_out.append(LeftOut(outcome.file, " ".join(verdict.reasons)))
        else:
            trials.append(outcome)
        warnings += [f"{outcome.file}: {warning}" for warning in verdict.warnings]
    idle = idle_cuts(trials, dataset.sensor.zeroed == "session")
    left_out += [LeftOut(file, why) for file, why in idle.items()]
    trials = [trial for trial in trials if trial.file not in idle]
    if not trials:
        listed = "\n".join(f"  {one.file}: {one.reason}" for one in left_out[:20])
        more = f"\n  and {len(left_out) - 20} more" if len(left_out) > 20 else ""
        raise ValueError(
            f"{where}: got no good trial, expected at least one; mend the trials below.\n{listed}{more}"
        )
    return replace(dataset, trials=tuple(trials), left_out=tuple(left_out), warnings=tuple(warnings))


def sift(dataset: Dataset) -> Dataset:
    """The dataset with each trial checked: for importers and for data made in memory. Raises ValueError as
    `finish` does.
    """
    verdicts = [
        (trial, check_trial(trial, dataset.tool, dataset.sensor, dataset.axes)) for trial in dataset.trials
    ]
    return finish(replace(dataset, trials=()), verdicts, where=dataset.name)


def feed_per_tooth_m(trial: Trial, tool: ToolInfo) -> float:
    """c = v / (N f_s) [m]: what one tooth moves forward before the next one follows."""
    return trial.feed_speed_m_s / (tool.teeth * trial.spindle_speed_rev_s)


def tooth_passing_hz(trial: Trial, tool: ToolInfo) -> float:
    """f_t = N f_s [Hz]."""
    return tool.teeth * trial.spindle_speed_rev_s


def aliased_hz(frequency_hz: float, sample_rate_hz: float) -> float:
    """Where a line appears after sampling: |f - f_sample round(f / f_sample)| [Hz]."""
    return abs(frequency_hz - sample_rate_hz * round(frequency_hz / sample_rate_hz))


def _check_conditions(trial: Trial, tool: ToolInfo) -> tuple[list[str], list[str]]:
    reasons: list[str] = []
    warnings: list[str] = []
    mill = tool.kind in ("end_mill", "slitting_saw")
    if mill and trial.milling is None:
        reasons.append(
            'milling: got null, expected "slot", "conventional" or "climb"; say how the cutter is engaged.'
        )
    if trial.kind == "cut":
        for name in ("feed_speed_m_s", "radial_depth_m", "axial_width_m"):
            if getattr(trial, name) <= 0:
                reasons.append(
                    f'{name}: got 0 in a cut, expected more than 0; correct it, or call the trial "air".'
                )
        chip_m = feed_per_tooth_m(trial, tool)
        if trial.feed_speed_m_s > 0 and not SMALLEST_FEED_PER_TOOTH_M <= chip_m <= LARGEST_FEED_PER_TOOTH_M:
            reasons.append(
                f"feed per tooth: got {chip_m * 1e6:.3g} um (feed {trial.feed_speed_m_s:g} m/s, "
                f"{tool.teeth} teeth, "
                f"{trial.spindle_speed_rev_s:g} rev/s), expected {SMALLEST_FEED_PER_TOOTH_M * 1e6:g} to "
                f"{LARGEST_FEED_PER_TOOTH_M * 1e6:g} um; give the feed in m/s (mm/min divided by 60000) and "
                "the "
                "speed in rev/s (rpm divided by 60)."
            )
        if mill and trial.radial_depth_m > tool.diameter_m * (1 + 1e-9):
            reasons.append(
                f"radial_depth_m: got {trial.radial_depth_m:g} m, expected at most the diameter "
                f"{tool.diameter_m:g} m; "
                "give metres, and the diameter for a slot."
            )
        elif trial.milling == "slot" and abs(trial.radial_depth_m - tool.diameter_m) > 0.01 * tool.diameter_m:
            warnings.append(
                f"radial_depth_m: got {trial.radial_depth_m:g} m for a slot, expected the diameter "
                f"{tool.diameter_m:g} m; "
                'a slot engages half a turn whatever is given: correct it, or set milling to "conventional" '
                'or "climb".'
            )
        if trial.axial_width_m > LARGEST_WIDTH_DIAMETERS * tool.diameter_m:
            reasons.append(
                f"axial_width_m: got {trial.axial_width_m:g} m, expected at most "
                f"{LARGEST_WIDTH_DIAMETERS:g} diameters "
                f"({LARGEST_WIDTH_DIAMETERS * tool.diameter_m:g} m); divide millimetres by 1000."
            )
    rim_m_s = np.pi * tool.diameter_m * trial.spindle_speed_rev_s
    if rim_m_s > LARGEST_CUTTING_SPEED_M_S:
        warnings.append(
            f"spindle_speed_rev_s: got {trial.spindle_speed_rev_s:g} rev/s, a cutting speed of "
            f"{rim_m_s:.0f} m/s, expected "
            f"at most {LARGEST_CUTTING_SPEED_M_S:g} m/s; divide rpm by 60."
        )
    return reasons, warnings


def _check_values(trial: Trial, channels: Channels) -> list[str]:
    if trial.samples < SHORTEST_RECORD:
        return [
            f"got {trial.samples} samples, expected at least {SHORTEST_RECORD} and two revolutions; record "
            "longer."
        ]
    reasons = []
    for name, values in (("time_s", trial.time_s), *channels):
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            reasons.append(
                f"{name}: got {len(bad)} values that are not finite (first at sample {bad[0]}), expected "
                "numbers "
                "throughout; cut the record there or interpolate the gap."
            )
    return reasons


def _check_time(trial: Trial, sensor: Sensor) -> list[str]:
    steps = np.diff(trial.time_s)
    if (steps <= 0).any():
        index = int(np.argmax(steps <= 0))
        return [
            f"time_s: got {trial.time_s[index + 1]:.9g} s after {trial.time_s[index]:.9g} s (sample "
            f"{index + 1}), expected "
            "increasing time; sort the record or remove the repeated part."
        ]
    typical = float(np.median(steps))
    worst = int(np.argmax(np.abs(steps - typical)))
    tolerance = max(UNEVEN_TOLERANCE * typical, _rounding_s(trial.time_s, typical))
    reasons = []
    if abs(steps[worst] - typical) > tolerance:
        reasons.append(
            f"time_s: got a step of {steps[worst]:.6g} s at sample {worst + 1} where the median step is "
            f"{typical:.6g} s, "
            f"expected even sampling within {tolerance:.2g} s; resample the record, or cut it at the gap."
        )
    else:
        rate_hz = (trial.samples - 1) / float(trial.time_s[-1] - trial.time_s[0])
        if abs(rate_hz / sensor.sample_rate_hz - 1) > RATE_TOLERANCE:
            reasons.append(
                f"time_s: got {rate_hz:.6g} samples a second, expected sensor.sample_rate_hz = "
                f"{sensor.sample_rate_hz:g} "
                "within 1 %; correct the time column or the rate."
            )
    if trial.revolutions < FEWEST_REVOLUTIONS:
        reasons.append(
            f"got {trial.revolutions:.2f} revolutions in {trial.time_s[-1] - trial.time_s[0]:.4g} s, "
            "expected at least "
            f"{FEWEST_REVOLUTIONS:g}; record longer, or give the speed in rev/s."
        )
    return reasons


def _rounding_s(time_s: np.ndarray, typical_s: float) -> float:
    """One unit of rounding where the stamps are decimals too coarse for the interval, else 0 [s]."""
    for digits in range(2, 8):
        scaled = time_s[:1000] * 10.0**digits
        if np.abs(scaled - np.round(scaled)).max() < 1e-3:
            unit_s = 10.0**-digits
            return 1.01 * unit_s if unit_s <= 0.5 * typical_s else 0.0
    return 0.0


def _check_saturation(channels: Channels) -> list[str]:
    reasons = []
    for name, values in channels:
        found = find_saturation(values)
        if found is not None:
            reasons.append(
                f"{name}: got saturation: {found.samples} samples at exactly {found.value:g}, up to "
                f"{found.longest_run} in a "
                "row, expected a force inside the sensor's range; record again with a larger range or a "
                "lighter cut."
            )
    return reasons


def _check_standstill(trial: Trial, channels: Channels) -> list[str]:
    reasons = []
    for index, (name, values) in enumerate(channels):
        others = [other for place, (_, other) in enumerate(channels) if place != index]
        found = find_standstill(values, others)
        if found is not None:
            reasons.append(
                f"{name}: got {found.value:g} in {found.samples} samples in a row (from "
                f"{trial.time_s[found.first]:.4g} s) while another channel went on, expected a force that "
                "varies; check the cable and the channel, cut the record there or record again."
            )
    return reasons


def _check_spikes(trial: Trial, channels: Channels, found: dict[str, NDArray[np.int64]]) -> list[str]:
    values = dict(channels)
    return [
        f"{name}: got {len(spikes)} samples far from their neighbours, up to "
        f"{float(np.abs(values[name][spikes]).max()):.4g} (first at {trial.time_s[spikes[0]]:.4g} s), "
        "expected none; tracing and fit-gp put a line between the neighbours in their place: check cables "
        "and plugs."
        for name, spikes in found.items()
    ]


def _check_dropouts(trial: Trial, lost: NDArray[np.int64]) -> list[str]:
    if not len(lost):
        return []
    return [
        f"got {len(lost)} samples that repeat the one before in every channel (first at "
        f"{trial.time_s[lost[0]]:.4g} s), expected none alike; tracing and fit-gp put a line between the "
        "neighbours in their place: look for samples lost between sensor and logger."
    ]


def _check_constant(channels: Channels) -> list[str]:
    return [
        f"{name}: got {values[0]:g} in every sample, expected a force that varies; check the cable and the "
        "channel."
        for name, values in channels
        if np.ptp(values) == 0
    ]


def _check_aliasing(trial: Trial, tool: ToolInfo, sensor: Sensor) -> list[str]:
    if tool.kind == "turning" or trial.kind == "air":
        return []
    rate_hz, passing_hz = sensor.sample_rate_hz, tooth_passing_hz(trial, tool)
    duration_s = float(trial.time_s[-1] - trial.time_s[0])
    for harmonic in range(1, HARMONICS + 1):
        line_hz = harmonic * passing_hz
        seen_hz = aliased_hz(line_hz, rate_hz)
        near_hz = max(0.02 * rate_hz, 2 / duration_s)
        filter_ = sensor.anti_alias
        passed = 1.0 if filter_ is None else 1 / np.hypot(1, (line_hz / filter_.hz) ** filter_.order)
        if line_hz > rate_hz / 2 and seen_hz < near_hz and passed > 0.01:
            name = "tooth passing" if harmonic == 1 else f"harmonic {harmonic} of tooth passing"
            return [
                f"{name}: got {line_hz:g} Hz sampled at {rate_hz:g} Hz, which appears at {seen_hz:.3g} Hz, "
                "expected it away "
                f"from 0 (above {near_hz:.3g} Hz); it corrupts the mean force. Change the speed by a few "
                "percent, "
                "sample faster, or filter before sampling."
            ]
    return []


def _check_measured_speed(trial: Trial) -> list[str]:
    nominal = trial.spindle_speed_rev_s
    warnings = []
    if trial.spindle_speed_measured_rev_s is not None:
        mean = float(np.mean(trial.spindle_speed_measured_rev_s))
        if abs(mean / nominal - 1) > SPEED_TOLERANCE:
            warnings.append(
                f"column spindle_speed_rev_s: got a mean of {mean:.4g} rev/s, expected the nominal "
                f"{nominal:g} within "
                f"{SPEED_TOLERANCE:.0%}; correct the nominal speed or the column's unit, unless the spindle "
                "droops that much."
            )
    if trial.spindle_angle_rad is not None:
        turned = float(np.sum(np.diff(np.unwrap(trial.spindle_angle_rad))))
        mean = turned / (2 * np.pi) / float(trial.time_s[-1] - trial.time_s[0])
        if abs(mean / nominal - 1) > SPEED_TOLERANCE:
            warnings.append(
                f"column spindle_angle_rad: got {mean:.4g} rev/s on average, expected the nominal "
                f"{nominal:g} within "
                f"{SPEED_TOLERANCE:.0%}; give radians that grow with the spindle's turning."
            )
    return warnings
