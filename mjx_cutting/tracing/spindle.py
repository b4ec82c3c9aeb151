"""The true spindle speed of a trial, found from its force record.

A cut repeats every revolution, so its energy stands at multiples of the spindle frequency f. The speed is the
f within `SPREAD` of the nominal that collects the most energy at its multiples; the error of that estimate
falls as T^(-3/2) (Rife and Boorstyn, IEEE Trans. Inf. Theory 20 (1974) 591-598). Lines above half the
sampling rate are looked for where they fold to. Where the spindle angle was measured, it is used and nothing
is estimated.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.trials.dataset import Trial

Array = NDArray[np.floating]
SPREAD = 0.01
_PAD = 8
_TOOTH_HARMONICS = 4
_REFINED = 12
_RESOLVED = 2.5
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def spindle_angle(trial: Trial, speed_rev_s: float) -> Array:
    """[T] angle of the spindle, rad: the measured one (unwrapped), else 2 pi f t from the first sample."""
    if trial.spindle_angle_rad is not None:
        return np.unwrap(trial.spindle_angle_rad)
    return 2.0 * np.pi * speed_rev_s * (trial.time_s - trial.time_s[0])


def spindle_speed(trial: Trial, teeth: int) -> float:
    """The trial's spindle speed, rev/s.

    Arguments:
        trial: the record; read are its forces, its times and its nominal speed.
        teeth: N; lines up to four times tooth passing are used.

    Returns the nominal speed where the record is silent.
    """
    nominal = trial.spindle_speed_rev_s
    if trial.spindle_angle_rad is not None:
        angle = np.unwrap(trial.spindle_angle_rad)
        return float(np.polyfit(trial.time_s, angle, 1)[0] / (2.0 * np.pi))
    time = trial.time_s - trial.time_s[0]
    signal = trial.signals[:, ~np.isnan(trial.signals).any(axis=0)]
    signal = signal - signal.mean(axis=0)
    if not signal.any():
        return nominal
    # a strong line must not leak onto the place of a weak one
    signal = signal * np.hanning(len(signal))[:, None]
    orders = _orders(trial, teeth)
    step = 1.0 / (_PAD * time[-1] * orders[-1])
    count = int(np.ceil(SPREAD * nominal / step))
    candidates = nominal + step * np.arange(-count, count + 1)
    power = _coarse_power(signal, time, orders, candidates)
    best = float(candidates[int(np.argmax(power))])
    strength = _comb(signal, time, orders, best)
    strongest = orders[np.argsort(strength)[-_REFINED:]]
    # the coarse spectrum cannot place the peak better than a bin of its strongest line
    bin_rev_s = 1.0 / (_PAD * time[-1] * orders[int(np.argmax(strength))])
    near = best + step * np.arange(-int(bin_rev_s / step) - 1, int(bin_rev_s / step) + 2)
    exact = [_comb(signal, time, strongest, float(each)).sum() for each in near]
    return _refine(signal, time, strongest, float(near[int(np.argmax(exact))]), step)


def _orders(trial: Trial, teeth: int) -> NDArray[np.int64]:
    """Tooth passing and its harmonics, and those spindle orders that do not fold.

    A folded spindle order could stand where tooth passing of another speed does; tooth passing itself is too
    strong to leave out.
    """
    rate_hz = (len(trial.time_s) - 1) / float(trial.time_s[-1] - trial.time_s[0])
    low = np.arange(1, teeth * _TOOTH_HARMONICS + 1)
    unfolded = low * trial.spindle_speed_rev_s * (1.0 + SPREAD) < 0.5 * rate_hz
    return low[unfolded | (low % teeth == 0)]


def _coarse_power(signal: Array, time: Array, orders: NDArray[np.int64], candidates: Array) -> Array:
    """[C] energy at the orders of each candidate speed, read from a zero-padded spectrum."""
    interval = (time[-1] - time[0]) / (len(time) - 1)
    length = int(2 ** np.ceil(np.log2(_PAD * len(time))))
    spectrum = np.sum(np.abs(np.fft.rfft(signal, n=length, axis=0)) ** 2, axis=1)
    cycles = np.multiply.outer(candidates, orders) * interval
    folded = np.abs(cycles - np.round(cycles))
    heard = _apart(folded / interval, cycles / interval, candidates[:, None], time[-1])
    return np.sum(spectrum[np.round(folded * length).astype(int)] * heard, axis=1)


def _apart(folded_hz: Array, frequency_hz: Array, speed_rev_s: Array | float, span_s: float) -> Array:
    """1 where a line stands alone, 0 where a folded one falls on a spindle order and would count it twice."""
    distance = np.abs(folded_hz - speed_rev_s * np.round(folded_hz / speed_rev_s))
    is_folded = np.abs(folded_hz - frequency_hz) > 1e-9 * frequency_hz
    return np.where(is_folded & (distance < _RESOLVED / span_s), 0.0, 1.0)


def _refine(signal: Array, time: Array, orders: NDArray[np.int64], start: float, step: float) -> float:
    """Golden-section search on the exact energy within a step of the start."""

    def power(speed: float) -> float:
        return float(_comb(signal, time, orders, speed).sum())

    low, high = start - step, start + step
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, at_right = power(left), power(right)
    for _ in range(30):
        if at_left > at_right:
            high, right, at_right = right, left, at_left
            left = high - _GOLDEN * (high - low)
            at_left = power(left)
        else:
            low, left, at_left = left, right, at_right
            right = low + _GOLDEN * (high - low)
            at_right = power(right)
    return 0.5 * (low + high)


def _comb(signal: Array, time: Array, orders: NDArray[np.int64], speed_rev_s: float) -> Array:
    """[F] exact energy of the record at each order of a speed; nothing is counted twice."""
    frequency = orders * speed_rev_s
    rate_hz = (len(time) - 1) / time[-1]
    folded = np.abs(frequency - rate_hz * np.round(frequency / rate_hz))
    wave = np.exp(-2j * np.pi * np.multiply.outer(frequency, time))
    energy = np.sum(np.abs(wave @ signal) ** 2, axis=1)
    return energy * _apart(folded, frequency, speed_rev_s, time[-1])
