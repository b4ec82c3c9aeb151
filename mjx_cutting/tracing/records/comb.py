"""The comb of a spindle speed: energy of a record at multiples of it, and how much each of them says."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.records.course import rate_hz
from mjx_cutting.tracing.records.even_time import even_time, from_start
from mjx_cutting.tracing.records.line_gain import filter_gain
from mjx_cutting.trials.dataset import AntiAlias, Trial

Array = NDArray[np.floating]
SPREAD = 0.01
PAD = 8
RESOLVED = 2.5
_TOOTH_HARMONICS = 4
_BETWEEN_TEETH = 0.6
_MOST_OF_A_LINE = 2.0
_SLOW = 0.5


def windowed(trial: Trial) -> tuple[Array, Array]:
    """The record as an even spindle would have shown it, windowed so that a strong line does not leak onto
    the place of a weak one; its times."""
    signal, time = trial.signals[:, ~np.isnan(trial.signals).any(axis=0)], from_start(trial)
    even = even_time(trial)
    if even is not None:
        signal = np.stack([np.interp(time, even, each) for each in signal.T], axis=-1)
    return (signal - signal.mean(axis=0)) * np.hanning(len(signal))[:, None], time


def folded_hz(frequency_hz: Array, rate_hz: float) -> Array:
    """Frequencies at which lines appear after sampling, Hz."""
    return np.abs(frequency_hz - rate_hz * np.round(frequency_hz / rate_hz))


def candidate_speeds(
    middle: float, below: float, above: float, time: Array, orders: NDArray[np.int64]
) -> tuple[Array, float]:
    """Speeds from `below` to `above` the middle, shares of it, as finely as the highest order tells apart."""
    step = 1.0 / (PAD * time[-1] * orders[-1])
    counts = [int(np.ceil(share * middle / step)) for share in (below, above)]
    return middle + step * np.arange(-counts[0], counts[1] + 1), step


def orders_told(trial: Trial, teeth: int) -> NDArray[np.int64]:
    """Tooth passing and its harmonics, and those spindle orders that do not fold.

    A folded spindle order could stand where tooth passing of another speed does; tooth passing itself is too
    strong to leave out.
    """
    low = np.arange(1, teeth * _TOOTH_HARMONICS + 1)
    unfolded = low * trial.spindle_speed_rev_s * (1.0 + SPREAD) < 0.5 * rate_hz(trial)
    return low[unfolded | (low % teeth == 0)]


def weights_of(orders: NDArray[np.int64], teeth: int) -> Array:
    """[F] tooth passing counts 1, its harmonic k as 1 / k, since that much weaker it is and folds anywhere;
    lines between count less than tooth passing, or a comb that holds it at another order would pass."""
    return np.where(orders % teeth == 0, teeth / orders, _BETWEEN_TEETH)


def coarse_power(
    signal: Array, time: Array, orders: NDArray[np.int64], candidates: Array, teeth: int
) -> Array:
    """[C, F] energy at the orders of each candidate speed, read from a zero-padded spectrum."""
    interval = (time[-1] - time[0]) / (len(time) - 1)
    length = int(2 ** np.ceil(np.log2(PAD * len(time))))
    spectrum = np.sum(np.abs(np.fft.rfft(signal, n=length, axis=0)) ** 2, axis=1)
    cycles = np.multiply.outer(candidates, orders) * interval
    folded = np.abs(cycles - np.round(cycles))
    heard = _apart(folded / interval, orders, teeth, time[-1])
    heard *= ~_slow(folded / interval, candidates, orders, teeth)
    return spectrum[np.round(folded * length).astype(int)] * heard


def _apart(folded_hz: Array, orders: NDArray[np.int64], teeth: int, span_s: float) -> Array:
    """[C, F] 1 where a line stands alone; of a tooth line and a line between teeth at one place, only the
    tooth line is heard, and of two tooth lines the lower.

    Arguments: folded_hz [C, F] where the lines of C speeds are found after sampling.
    """
    heard = np.ones(folded_hz.shape)
    is_tooth = orders % teeth == 0
    for index in np.flatnonzero(is_tooth):
        close = np.abs(folded_hz - folded_hz[:, index : index + 1]) < RESOLVED / span_s
        heard[close & (~is_tooth | (orders > orders[index]))] = 0.0
    return heard


def _slow(folded_hz: Array, candidates: Array, orders: NDArray[np.int64], teeth: int) -> NDArray[np.bool_]:
    """[C, F] the harmonics of tooth passing that fold to where the force itself changes slowly, by layers or
    at the ends of the cut, while tooth passing does not: it tells the speed without them."""
    slow = folded_hz < _SLOW * candidates[:, None]
    passing = slow[:, orders == teeth]
    return slow & (orders % teeth == 0) & (orders > teeth) & ~passing


def comb(
    signal: Array,
    time: Array,
    orders: NDArray[np.int64],
    speed_rev_s: float,
    teeth: int,
    most: Array,
) -> Array:
    """[F] exact energy of the record at each order of a speed, weighted; of each no more than `most` [F]."""
    wave = turning_against(time, orders * speed_rev_s)
    return np.minimum(np.sum(np.abs(wave @ signal) ** 2, axis=1), most) * weights_of(orders, teeth)


def most_power(trial: Trial, frequency_hz: Array, alias: AntiAlias | None) -> Array:
    """[F] the most that a line of a frequency can hold of the windowed record, behind a filter that is known:
    as many times what would be if all of the force were one wave there."""
    force = trial.signals[:, ~np.isnan(trial.signals).any(axis=0)]
    wave = 0.5 * len(force) * np.sqrt(0.5 * np.sum(np.mean(force**2, axis=0)))
    return (_MOST_OF_A_LINE * wave * np.abs(filter_gain(alias, frequency_hz))) ** 2


def turning_against(time: Array, frequency_hz: Array) -> NDArray[np.complexfloating]:
    """[F, T] a turn against each frequency."""
    return np.asarray(np.exp(-2j * np.pi * np.multiply.outer(frequency_hz, time)))


def standing_alone(time: Array, orders: NDArray[np.int64], speed_rev_s: float, teeth: int) -> Array:
    """[F] 1 for the orders whose lines no other comes near after sampling, and of those that come near each
    other for the one of tooth passing, which is the stronger; all, where there is no such."""
    folded = folded_hz(orders * speed_rev_s, (len(time) - 1) / time[-1])
    near = np.abs(np.subtract.outer(folded, folded)) < RESOLVED / time[-1]
    is_tooth = orders % teeth == 0
    alone = (near.sum(axis=1) == 1) | (is_tooth & (near[:, is_tooth].sum(axis=1) == 1))
    return alone.astype(float) if alone.any() else np.ones(len(orders))
