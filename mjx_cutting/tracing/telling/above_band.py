"""What the record holds above the band compared, where the sensor could be trusted further than was asked.

Nothing there is fitted. It is told how much stands in lines, beside what the model found below calculates
there, and where most of it is: force that teeth put in is raised near a resonance of the tool, the table or
the sensor, and that is a reason to end the band below it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import ForceModel
from mjx_cutting.tracing.along.predicted import predict_trials
from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import trusted_band
from mjx_cutting.trials.dataset import Dataset

_FURTHER = 1.25
_LOOKED_AT = 8.0
_LEAST = 0.05
_MOST_OF_IT = 2.0 / 3.0
_BINS_A_TURN = 4
Array = NDArray[np.floating]


@dataclass(frozen=True)
class Above:
    """Force above the band compared.

    Fields:
        top_hz: up to where was looked.
        lines, left: root mean square of what stands there in lines, and of what the model leaves of it, over
            that of the force in the band.
        low_hz, high_hz: the narrowest range that holds two thirds of the lines' energy.
        measured, calculated: lines in that range, and what the model makes of them, by the same measure.
    """

    top_hz: float
    lines: float
    left: float
    low_hz: float
    high_hz: float
    measured: float
    calculated: float

    def __str__(self) -> str:
        return (
            f"above the band compared, up to {self.top_hz:.0f} Hz, stand lines of {self.lines:.0%} of the "
            f"force in the band, of which the model leaves {self.left:.0%}; most of them at "
            f"{self.low_hz:.0f} to {self.high_hz:.0f} Hz, {self.measured:.0%} measured and "
            f"{self.calculated:.0%} calculated. Not fitted: force that the teeth put in is raised near a "
            "resonance of the tool, the table or the sensor; tap the table and look for it there"
        )


def above_band(dataset: Dataset, model: ForceModel, band_hz: tuple[float, float]) -> Above | None:
    """What stands in lines above `band_hz`; None where the sensor ends there, or hardly anything does."""
    top_hz = min(trusted_band(dataset, None)[1], _LOOKED_AT * band_hz[1])
    if dataset.tool.kind in LEVEL_KINDS or top_hz < _FURTHER * band_hz[1]:
        return None
    trials = predict_trials(dataset, model, (band_hz[0], top_hz))
    width_hz = min(each.speed_rev_s for each in trials) / _BINS_A_TURN
    edges = np.append(np.arange(band_hz[1], top_hz, width_hz), top_hz)
    force, measured, calculated, left = 0.0, *np.zeros((3, len(edges) - 1))
    for each in trials:
        measured += _in_lines(each, each.measured_n, edges)
        calculated += _in_lines(each, each.predicted_n, edges)
        left += _in_lines(each, each.residual_n, edges)
        force += _below(each, band_hz[1])
    if left.sum() < _LEAST**2 * force:
        return None
    first, last = _narrowest(measured, _MOST_OF_IT)
    low_hz, high_hz = float(edges[first]), float(edges[last + 1])
    here = slice(first, last + 1)
    energy = np.array([measured.sum(), left.sum(), measured[here].sum(), calculated[here].sum()])
    lines, rest, there, made = np.sqrt(energy / force).tolist()
    return Above(top_hz, lines, rest, low_hz, high_hz, there, made)


def _spectrum(trial: Prediction, force_n: Array) -> tuple[Array, Array]:
    """Frequencies [K] and energy [K] over the axes, mean square of the record."""
    count = len(force_n)
    rate_hz = (count - 1) / float(trial.time_s[-1])
    energy = np.sum(np.abs(np.fft.rfft(force_n, axis=0)) ** 2, axis=1) * 2.0 / count**2
    energy[0] *= 0.5
    return np.fft.rfftfreq(count, 1.0 / rate_hz), energy


def _below(trial: Prediction, top_hz: float) -> float:
    frequency, energy = _spectrum(trial, trial.measured_n)
    return float(energy[frequency <= top_hz].sum())


def _in_lines(trial: Prediction, force_n: Array, edges_hz: Array) -> Array:
    """[B] mean square in each range of frequency beyond the noise, of which the median there tells."""
    frequency, energy = _spectrum(trial, force_n)
    found = np.zeros(len(edges_hz) - 1)
    for index, (low, high) in enumerate(pairwise(edges_hz)):
        here = energy[(frequency >= low) & (frequency < high)]
        if len(here) > 2:
            found[index] = max(float(here.sum() - len(here) * np.median(here) / np.log(2.0)), 0.0)
    return found


def _narrowest(energy: Array, share: float) -> tuple[int, int]:
    """First and last of the fewest neighbours that hold a share of the whole; of several, those with most."""
    total = np.concatenate([[0.0], np.cumsum(energy)])
    for width in range(1, len(energy) + 1):
        within = total[width:] - total[:-width]
        if within.max() >= share * total[-1]:
            break
    first = int(np.argmax(within))
    return first, first + width - 1
