"""The least error any model can leave: sensor noise, less the lines that machine and mains put beside it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter

from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import Lines
from mjx_cutting.trials.dataset import Dataset

_FEWEST = 64
_NEAR = 101
_ABOVE = 16.0
_LEAKS = 5
Array = NDArray[np.floating]


def noise_floor(dataset: Dataset, lines: Lines, left: Sequence[Array] = ()) -> float:
    """Heldout NRMSE that sensor noise alone leaves: from air cuts, the stated noise, or between the lines,
    of the spindle and any other; for levels, of which all that changes in a trial lies beside, from what is
    alike at all frequencies.

    Of a drill that is so whatever is stated: thrust and torque have no common noise.

    Arguments: `left` [T, 3] what a model leaves of every cut trial: what it explains of the force between the
        lines, as of a feed that goes in steps, is no noise.
    """
    force = np.sqrt(lines.energy_n2.sum() / (3.0 * lines.samples.sum()))
    return float(np.sqrt(_power(dataset, lines, left).mean()) / max(force, 1e-12))


def noise_in_shares(dataset: Dataset, lines: Lines) -> float:
    """The same with every axis a share of its own force, as thrust and torque of a drill must be."""
    force_n2 = lines.energy_n2.sum(axis=0) / lines.samples.sum()
    measured = force_n2 > 0.0
    return float(np.sqrt(np.mean(_power(dataset, lines, ())[measured] / force_n2[measured])))


def _power(dataset: Dataset, lines: Lines, left: Sequence[Array]) -> NDArray[np.float64]:
    """[3] mean square of the noise; of cutters alike on all axes."""
    rate, band = dataset.sensor.sample_rate_hz, lines.band_hz
    air = [trial for trial in dataset.trials if trial.kind == "air"]
    cuts = [trial.force_n for trial in dataset.trials if trial.kind == "cut"]
    if air:
        return np.mean([power_between_lines(trial.force_n, rate, band) for trial in air], axis=0)
    if dataset.sensor.noise_std_n is not None and dataset.tool.kind != "drill":
        share = (band[1] - band[0]) / (0.5 * rate)
        return np.square(dataset.sensor.noise_std_n) * share
    if dataset.tool.kind in LEVEL_KINDS:
        return np.mean([white_power(each, rate, band) for each in cuts], axis=0)
    rest = lines.rest_n2.sum() / (3.0 * lines.samples.sum())
    between = (
        np.mean([np.mean(power_between_lines(each, rate, band)) for each in records])
        for records in (cuts, left)
        if len(records)
    )
    return np.full(3, min(rest, *between))


def white_power(record: Array, rate_hz: float, band_hz: tuple[float, float]) -> NDArray[np.float64]:
    """[A] mean square in a band of that part of a record [T, A] which is alike at all its frequencies.

    By the median of the periodogram, which a few lines and what is slow do not move.
    """
    power, inside = periodogram(record, rate_hz, band_hz)
    if not inside.any():
        return np.zeros(record.shape[1])
    alike = np.median(power[inside], axis=0) / np.log(2.0)  # of an exponential distribution
    return np.asarray(alike * inside.sum())


def power_between_lines(record: Array, rate_hz: float, band_hz: tuple[float, float]) -> NDArray[np.float64]:
    """[A] mean square in a band of a record [T, A] less its lines: of an unbalanced spindle, say, or mains.

    A bin far above those around it, and what leaks beside it, counts as much as they do. A record too short
    to show lines is counted whole.
    """
    if len(record) < _FEWEST:
        return np.asarray(np.var(record, axis=0))
    power, inside = periodogram(record, rate_hz, band_hz)
    near = median_filter(power, size=(min(_NEAR, len(power)), 1), mode="reflect") / np.log(2.0)
    line = maximum_filter1d(power > _ABOVE * near, _LEAKS, axis=0)
    return np.asarray(np.where(line, near, power)[inside].sum(axis=0))


def periodogram(
    record: Array, rate_hz: float, band_hz: tuple[float, float]
) -> tuple[Array, NDArray[np.bool_]]:
    """[F, A] mean square in each bin but the mean's, windowed so that a line stays where it is; [F] whether
    it lies in the band."""
    window = np.hanning(len(record))
    power = np.abs(np.fft.rfft((record - record.mean(axis=0)) * window[:, None], axis=0)[1:]) ** 2
    frequency = np.fft.rfftfreq(len(record), 1.0 / rate_hz)[1:]
    power *= 2.0 / (len(record) * np.sum(window**2))
    return power, (frequency >= band_hz[0]) & (frequency <= band_hz[1])
