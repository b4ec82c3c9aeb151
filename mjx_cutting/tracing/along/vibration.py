"""The pattern of lines f_c + k f_t that holds most of what the spindle's orders leave of one record.

Its lines are those tooth passings apart from the strongest that stand far above the noise; their common
frequency is refined. Amplitudes are fitted on every other stretch of the record and scored on those between,
so that noise, and a gain that wanders, gain nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.records.lines import Lines, basis

FAR_ABOVE = 30.0
RESOLVED = 2.0
_PAD = 4
_STRETCHES = 16
_SIDEBAND = 12.0
_MOST_LINES = 16
_SHIFTS = 13
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Vibration:
    """The best pattern in one trial.

    Fields:
        frequency_hz: its strongest line, or one nearly as strong that other trials share.
        lines_hz: [L] its lines that stand above the noise, the strongest first.
        over_noise: [L] their energy over that of the noise.
        wave_n: [T, 3] the pattern fitted to the whole record.
        error_change_n2: [3] change of the squared error on stretches that were not fitted to.
    """

    frequency_hz: float
    lines_hz: Array
    over_noise: Array
    wave_n: Array
    error_change_n2: Array

    @property
    def found(self) -> bool:
        """True for two lines far above the noise that hold on stretches not fitted to."""
        strong = len(self.over_noise) > 1 and self.over_noise[0] > FAR_ABOVE
        return bool(strong and self.error_change_n2.sum() < 0.0)


def vibration(trial: Prediction, left_n: Array, lines: Lines, teeth: int, weight: Array) -> Vibration:
    """The pattern of lines f_c + k f_t that holds most of what the spindle's orders leave.

    Arguments: trial: its times, angle and speed; left_n [T, 3] the residual looked at; weight [3] 1 / noise.
    """
    time, tooth_hz = trial.time_s, teeth * trial.speed_rev_s
    columns = basis(trial.angle_rad, lines.orders)
    rest = (left_n - columns @ _solved(columns, left_n)) * weight
    rate_hz = (len(time) - 1) / time[-1]
    window = np.hanning(len(time))
    length = int(2 ** np.ceil(np.log2(_PAD * len(time))))
    spectrum = np.sum(np.abs(np.fft.rfft(rest * window[:, None], n=length, axis=0)) ** 2, axis=1)
    frequency = np.fft.rfftfreq(length, 1.0 / rate_hz)
    band = (frequency >= max(lines.band_hz[0], RESOLVED / time[-1])) & (frequency <= lines.band_hz[1])
    noise = float(np.median(spectrum[band]))
    over = np.where(band, spectrum, 0.0) / max(noise, 1e-300)
    top = 0.5 * rate_hz
    strongest = float(frequency[int(np.argmax(over))])
    steps = np.arange(-int(lines.band_hz[1] / tooth_hz) - 2, int(lines.band_hz[1] / tooth_hz) + 3)
    pattern = np.abs(strongest + steps * tooth_hz)
    found, energy = [], []
    for line in pattern[pattern < top]:
        near = np.abs(frequency - line) <= 1.0 / time[-1]
        size = float(over[near].max()) if near.any() else 0.0
        if size > (FAR_ABOVE if abs(line - strongest) < 1e-9 else _SIDEBAND):
            found.append(float(line))
            energy.append(size)
    order: list[int] = []
    for index in np.argsort(energy)[::-1]:
        # two lines of the pattern that fold onto one place are one
        if all(abs(found[index] - found[other]) > RESOLVED / time[-1] for other in order):
            order.append(int(index))
    order = order[:_MOST_LINES]
    chosen, over_noise = np.array([found[i] for i in order]), np.array([energy[i] for i in order])
    return _fitted(time, rest / weight, chosen, over_noise, strongest, tooth_hz)


def _fitted(
    time: Array, rest: Array, chosen: Array, over: Array, strongest: float, tooth_hz: float
) -> Vibration:
    """The lines chosen, their common frequency refined, fitted to the whole and to every other stretch."""
    if len(chosen) < 2:
        return Vibration(strongest, chosen, over, np.zeros_like(rest), np.zeros(3))
    stretch = np.floor(time / time[-1] * _STRETCHES * (1.0 - 1e-9)).astype(int) % 2

    def columns(shift: float) -> Array:
        # all lines move together: those folded through zero the other way
        step = np.where(_mirrored(chosen, strongest, tooth_hz), -shift, shift)
        turn = 2.0 * np.pi * np.multiply.outer(time, chosen + step)
        return np.concatenate([np.cos(turn), np.sin(turn)], axis=1)

    def fit(part: NDArray[np.bool_]) -> tuple[Array, Array]:
        def left(shift: float) -> float:
            x = columns(shift)[part]
            return float(np.sum((rest[part] - x @ _solved(x, rest[part])) ** 2))

        best, reach = 0.0, 0.5 / time[-1]
        for _ in range(2):
            shifts = best + reach * np.linspace(-1.0, 1.0, _SHIFTS)
            best = float(shifts[int(np.argmin([left(shift) for shift in shifts]))])
            reach /= 0.5 * (_SHIFTS - 1)
        x = columns(best)
        return x, _solved(x[part], rest[part])

    change = np.zeros(3)
    for kept in (0, 1):
        x, weights = fit(stretch == kept)
        other = stretch != kept
        change += np.sum((rest[other] - (x @ weights)[other]) ** 2, axis=0)
        change -= np.sum(rest[other] ** 2, axis=0)
    x, weights = fit(np.ones(len(time), bool))
    return Vibration(strongest, chosen, over, x @ weights, change)


def _solved(x: Array, y: Array) -> Array:
    """Least-squares weights by normal equations; what the columns cannot tell apart is kept small."""
    normal = x.T @ x
    return np.linalg.solve(normal + 1e-9 * np.trace(normal) / len(normal) * np.eye(len(normal)), x.T @ y)


def _mirrored(chosen: Array, strongest: float, tooth_hz: float) -> NDArray[np.bool_]:
    """[L] True for lines at k f_t - f_c, which fall when f_c rises."""
    turns = (chosen - strongest) / tooth_hz
    return np.abs(turns - np.round(turns)) > 1e-6
