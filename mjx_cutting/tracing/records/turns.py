"""The columns exp(i n th) of a turning tool, and what a measured angle tells beyond its speed.

A model's lines are multiplied by what the known anti-alias filter makes of a line of even speed. A spindle
that runs ahead and falls behind within a turn, as its measured angle shows, puts sidebands beside every
line, and the filter lets each through in its own way: later, and below a tooth passing near its corner far
more than the tooth passing itself. So there the columns themselves are sent through the filter
(`filtered_turns`), those too that stand outside the band but have sidebands in it (`reach`).

An angle that was measured finely holds a ripple within the turn; one put together from a pulse a turn grows
evenly between them and holds none (`holds_ripple`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.records.even_time import from_start
from mjx_cutting.tracing.records.line_gain import filter_gain
from mjx_cutting.trials.dataset import Sensor, Trial

_ORDERS = np.arange(2, 51)
_MOST_ORDER = 15
_STANDS_OUT = 25.0
_ROUNDING_RAD = 1e-7
_STILL_RAD = 1e-3
_SLOW = 8
_LEAST_SIDEBAND = 0.2
# of the best of these orders, where noise alone makes the angle: its power falls off exponentially
CHANCE = len(_ORDERS) * 2.0**-_STANDS_OUT
Array = NDArray[np.floating]


def turns(angle_rad: Array, orders: int) -> NDArray[np.complexfloating]:
    """[orders + 1, T] exp(i n th) for n = 0..orders."""
    power = np.empty((orders + 1, len(angle_rad)), dtype=complex)
    power[0], known = 1.0, 1
    while known <= orders:
        more = min(known, orders + 1 - known)
        np.multiply(power[:more], np.exp(1j * known * angle_rad), out=power[known : known + more])
        known += more
    return power


def real_columns(power: NDArray[np.complexfloating]) -> Array:
    """[T, 2 orders + 1] columns 1, cos n th, sin n th for n = 1..orders, of `turns` [orders + 1, T]."""
    columns = np.empty((2 * len(power) - 1, power.shape[1]))
    columns[0], columns[1::2], columns[2::2] = 1.0, power[1:].real, power[1:].imag
    return columns.T


def filtered_turns(angle_rad: Array, orders: int, sensor: Sensor) -> NDArray[np.complexfloating]:
    """[orders + 1, T] `turns` behind the known filter, each over the filter's response to it at even speed.

    Arguments: the angle [T] at every sample of a record, rad; highest order; whose filter and sampling rate.
    """
    alias = sensor.anti_alias
    if alias is None:
        return turns(angle_rad, orders)
    repeats = swing(angle_rad)
    if orders * float(np.ptp(repeats)) < _STILL_RAD:
        return turns(angle_rad, orders)
    rate_hz, last = sensor.sample_rate_hz, len(angle_rad) - 1
    turn_hz = float(angle_rad[-1] - angle_rad[0]) * rate_hz / (2.0 * np.pi * last)
    beside_hz = np.fft.fftfreq(len(angle_rad), 1.0 / rate_hz)
    sidebands = turns(repeats, orders)
    for order in range(1, orders + 1):
        response = filter_gain(alias, order * turn_hz + beside_hz)
        sidebands[order] = np.fft.ifft(np.fft.fft(sidebands[order]) * response / response[0])
    return turns(angle_rad - repeats, orders) * sidebands


def reach(trial: Trial) -> int:
    """How many orders beside a line its sidebands stand, by the measured angle; 0 where it shows none."""
    if not holds_ripple(trial):
        return 0
    assert trial.spindle_angle_rad is not None
    even, uneven = even_angle(trial)
    size = np.abs(turns(even, _most_order(even))[1:] @ (uneven * np.hanning(len(uneven))))
    return 1 + int(np.flatnonzero(size > _LEAST_SIDEBAND * size.max()).max())


def holds_ripple(trial: Trial) -> bool:
    """Whether the angle of the spindle was measured, and is uneven at a multiple of its turn other than the
    first, which an encoder off its centre would show too."""
    if trial.spindle_angle_rad is None:
        return False
    even, uneven = even_angle(trial)
    orders = _ORDERS[_ORDERS * float(np.ptp(even)) < np.pi * len(even)]
    if not len(orders):
        return False
    uneven = uneven * np.hanning(len(uneven))
    beside = np.concatenate([orders - 0.5, orders + 0.5])
    of_turn, between = (np.abs(np.exp(-1j * np.multiply.outer(n, even)) @ uneven) for n in (orders, beside))
    least = max(_STANDS_OUT * float(np.median(between**2)), (_ROUNDING_RAD * len(even)) ** 2)
    return bool(of_turn.max() ** 2 > least)


def even_angle(trial: Trial) -> tuple[Array, Array]:
    """[T] the straight line through the measured angle, and [T] the rest of it, rad."""
    assert trial.spindle_angle_rad is not None
    time_s, angle = from_start(trial), np.unwrap(trial.spindle_angle_rad)
    even = np.polyval(np.polyfit(time_s, angle, 1), time_s)
    return even, angle - even


def swing(angle_rad: Array) -> Array:
    """[T] by how far an angle [T] is ahead of one that changes slowly in the same way every turn, rad."""
    at = np.linspace(-1.0, 1.0, len(angle_rad))
    slow = np.polynomial.legendre.legval(at, np.polynomial.legendre.legfit(at, angle_rad, _SLOW))
    columns = real_columns(turns(slow, _most_order(slow)))[:, 1:]
    weights, *_ = np.linalg.lstsq(columns, angle_rad - slow, rcond=None)
    return np.asarray(columns @ weights)


def _most_order(even: Array) -> int:
    return max(int(min(_MOST_ORDER, np.pi * len(even) / max(float(np.ptp(even)), 1.0))), 1)
