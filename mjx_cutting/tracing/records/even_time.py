"""How a spindle turned within a record, where its speed was measured beside the force.

The integral of the speed is the angle, and with it every line stays where it is while the spindle speeds up
or gives way. But noise in a speed adds up too, to an angle that wanders. So only the slow part of what was
measured is followed: the cosines over the record, slower than a turn, that stand out of those faster than
they are, and these only where they move the speed by more than the column can tell apart.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct

from mjx_cutting.trials.dataset import Trial

_MOST = 24
_FASTER = 8
_STANDS_OUT = 25.0
_MEDIAN_SQUARE = 0.455  # of a standard normal
_STEPS = 2.0
Array = NDArray[np.floating]


def even_time(trial: Trial) -> Array | None:
    """[T] time at which a spindle that turns evenly, at the mean speed of the record, had turned as far, s
    from its beginning; None where no speed was measured, or none that is seen to change."""
    time_s, measured = from_start(trial), trial.spindle_speed_measured_rev_s
    if measured is None or np.ptp(measured) == 0.0:
        return None
    change = _slow(measured / np.mean(measured) - 1.0, float(np.mean(measured) * time_s[-1]))
    if np.ptp(change) < _STEPS * _step(measured) / np.mean(measured):
        return None
    interval = np.diff(time_s, prepend=0.0)
    ahead = np.cumsum(0.5 * (change + np.concatenate([change[:1], change[:-1]])) * interval)
    return np.asarray(time_s + ahead - ahead[-1] * time_s / time_s[-1])


def later(trial: Trial) -> Array | None:
    """[T] by how much longer than on the mean the spindle takes for a turn, a share; None where its speed is
    not seen to change."""
    even = even_time(trial)
    return None if even is None else 1.0 / np.gradient(even, from_start(trial)) - 1.0


def from_start(trial: Trial) -> Array:
    """[T] time from the first sample, s."""
    return np.asarray(trial.time_s - trial.time_s[0])


def _slow(change: Array, turns: float) -> Array:
    """The part of a speed [T] that surely changes, less its mean, over a record of so many turns."""
    size = dct(change, norm="ortho")
    most = int(min(_MOST, turns, len(size) // (2 * _FASTER)))
    if most < 1:
        return np.zeros_like(change)
    noise = np.median(size[most + 1 : most * _FASTER] ** 2) / _MEDIAN_SQUARE
    kept = np.zeros_like(size)
    sure = slice(1, most + 1)
    kept[sure] = np.where(size[sure] ** 2 > _STANDS_OUT * noise, size[sure], 0.0)
    return np.asarray(idct(kept, norm="ortho"))


def _step(measured: Array) -> float:
    """What the column tells apart: the least difference between two of its values."""
    return float(np.min(np.diff(np.unique(measured))))
