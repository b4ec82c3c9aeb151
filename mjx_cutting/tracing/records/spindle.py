"""The true spindle speed of a trial, found from its force record.

A cut repeats every revolution, so its energy stands at multiples of the spindle frequency f. The speed is the
f within `SPREAD` of the nominal that collects the most energy at its multiples; the error of that estimate
falls as T^(-3/2) (Rife and Boorstyn, IEEE Trans. Inf. Theory 20 (1974) 591-598). Lines above half the
sampling rate are looked for where they fold to, but no line counts more than a known filter could have let
through: a strong one of the spindle's own order may stand where tooth passing of another speed folds to.
Where the spindle angle was measured, it is used and nothing is estimated. Where a measured speed changes
within the record, the multiples are those of the angle that it integrates to (`even_time`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.records.blocks import block_edges, block_means
from mjx_cutting.tracing.records.comb import (
    PAD,
    SPREAD,
    candidate_speeds,
    coarse_power,
    comb,
    most_power,
    orders_told,
    standing_alone,
    turning_against,
    weights_of,
    windowed,
)
from mjx_cutting.tracing.records.course import rate_hz
from mjx_cutting.tracing.records.even_time import even_time, from_start
from mjx_cutting.trials.dataset import AntiAlias, Dataset, Trial

Array = NDArray[np.floating]
_REFINED = 12
_BLOCKS = 1024
_STRONG = 0.05
_BESIDE = 0.5
_APART = 0.5
_AS_MUCH = 0.995
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def spindle_angle(trial: Trial, speed_rev_s: float) -> Array:
    """[T] angle of the spindle, rad: the measured one (unwrapped), else from the first sample that of a speed
    which was seen to change, 2 pi f on the mean, else 2 pi f t."""
    if trial.spindle_angle_rad is not None:
        return np.unwrap(trial.spindle_angle_rad)
    even = even_time(trial)
    return 2.0 * np.pi * speed_rev_s * (from_start(trial) if even is None else even)


def stated_speed(trial: Trial) -> float:
    """What the record says of the spindle speed, rev/s: the mean of its speed column, else the nominal."""
    measured = trial.spindle_speed_measured_rev_s
    return trial.spindle_speed_rev_s if measured is None else float(np.mean(measured))


def measured_speed(trial: Trial) -> float | None:
    """What a measured angle, else a speed column, says of the spindle speed, rev/s; None without either."""
    if trial.spindle_angle_rad is not None:
        return float(np.polyfit(trial.time_s, np.unwrap(trial.spindle_angle_rad), 1)[0] / (2.0 * np.pi))
    measured = trial.spindle_speed_measured_rev_s
    return None if measured is None else float(np.mean(measured))


def spindle_speed(
    trial: Trial,
    teeth: int,
    alias: AntiAlias | None,
    about_rev_s: float | None = None,
    spread: float = SPREAD,
) -> float:
    """The trial's spindle speed, rev/s.

    Arguments:
        trial: the record; read are its forces, its times and its stated speed.
        teeth: N; lines up to four times tooth passing are used.
        alias: the filter known to stand before sampling, if any.
        about_rev_s: middle of the range searched, default the stated speed; `spread` half of that range, as
            a share of it.

    Returns the middle of the range where the record is silent.
    """
    middle = stated_speed(trial) if about_rev_s is None else about_rev_s
    if trial.spindle_angle_rad is not None and (turned := measured_speed(trial)) is not None:
        return turned
    signal, time = windowed(trial)
    if not signal.any():
        return middle
    orders = orders_told(trial, teeth)
    candidates, step = candidate_speeds(middle, spread, spread, time, orders)
    most = most_power(trial, orders * middle, alias)
    power = np.minimum(coarse_power(signal, time, orders, candidates, teeth), most)
    at = int(np.argmax(power @ weights_of(orders, teeth)))
    folds = teeth * middle * (1.0 + spread) > 0.5 * rate_hz(trial)
    apart = teeth * spread < _APART
    if apart and not folds and _beside_tooth_passing(power[:, orders == teeth][:, 0], power.max(), at):
        told = orders % teeth == 0
        orders, most, power = orders[told], most[told], power[:, told]
        at = int(np.argmax(power @ weights_of(orders, teeth)))
    best = float(candidates[at])
    strength = comb(signal, time, orders, best, teeth, most) * standing_alone(time, orders, best, teeth)
    strongest = orders[np.argsort(strength)[-_REFINED:]]
    strongest = strongest[np.sort(strength)[-_REFINED:] > 0.0]
    # the coarse spectrum cannot place the peak better than a bin of its strongest line
    bin_rev_s = 1.0 / (PAD * time[-1] * orders[int(np.argmax(strength))])
    near = best + step * np.arange(-int(bin_rev_s / step) - 1, int(bin_rev_s / step) + 2)
    energy = _energy_near(signal, time, strongest, best, teeth)
    found = _refine(energy, float(near[int(np.argmax([energy(float(each)) for each in near]))]), step)
    mirror = mirror_speed(found, teeth, rate_hz(trial))
    if abs(mirror - middle) < abs(found - middle):
        here, there = (
            float(np.sum(comb(signal, time, orders, each, teeth, most))) for each in (found, mirror)
        )
        return mirror if there > _AS_MUCH * here else found
    return found


def mirror_speed(speed_rev_s: float, teeth: int, rate_hz: float) -> float:
    """The speed at which tooth passing, and with it every harmonic of it, folds to where it does at the one
    given, from the other side of a multiple of half the sampling rate: the same lines, turning backwards."""
    passing_hz = teeth * speed_rev_s
    return (rate_hz * float(np.round(2.0 * passing_hz / rate_hz)) - passing_hz) / teeth


def as_turned(dataset: Dataset) -> Dataset:
    """The data set, the speeds that were measured in its cuts left out of account, but for their mean, where
    the force has its lines at an even speed rather than along the angle that they integrate to."""
    teeth, alias = dataset.tool.teeth, dataset.sensor.anti_alias
    return replace(dataset, trials=tuple(_agreed(trial, teeth, alias) for trial in dataset.trials))


def _agreed(trial: Trial, teeth: int, alias: AntiAlias | None) -> Trial:
    measured = trial.spindle_speed_measured_rev_s
    if measured is None or trial.kind != "cut" or even_time(trial) is None:
        return trial
    evenly = replace(trial, spindle_speed_measured_rev_s=np.full_like(measured, np.mean(measured)))
    return evenly if _collected(evenly, teeth, alias) > _collected(trial, teeth, alias) else trial


def _collected(trial: Trial, teeth: int, alias: AntiAlias | None) -> float:
    """Energy at the orders of the trial's spindle speed."""
    speed, orders = spindle_speed(trial, teeth, alias), orders_told(trial, teeth)
    most = most_power(trial, orders * speed, alias)
    return float(np.sum(comb(*windowed(trial), orders, speed, teeth, most)))


def _beside_tooth_passing(passing: Array, most: float, at: int) -> bool:
    """Whether a strong line of tooth passing stands elsewhere than the speed of most energy has it: then what
    the other orders collect there is not of the spindle, but of a vibration stronger than tooth passing.

    Arguments: passing [C] energy at tooth passing of each candidate speed, of which the one `at` has most in
        all; `most` the largest at any order.
    """
    peak = int(np.argmax(passing))
    inside = 0 < peak < len(passing) - 1
    return bool(inside and passing[peak] > _STRONG * most and passing[at] < _BESIDE * passing[peak])


def _refine(energy: Callable[[float], float], start: float, step: float) -> float:
    """Golden-section search for the speed of most energy within a step of the start."""
    low, high = start - step, start + step
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, at_right = energy(left), energy(right)
    for _ in range(30):
        if at_left > at_right:
            high, right, at_right = right, left, at_left
            left = high - _GOLDEN * (high - low)
            at_left = energy(left)
        else:
            low, left, at_left = left, right, at_right
            right = low + _GOLDEN * (high - low)
            at_right = energy(right)
    return 0.5 * (low + high)


def _energy_near(
    signal: Array, time: Array, orders: NDArray[np.int64], speed_rev_s: float, teeth: int
) -> Callable[[float], float]:
    """Energy at the orders of any speed near the one given, weighted.

    The record is turned back by the speed given; what then turns slowly is summed over blocks of time.
    """
    edges = block_edges(len(time), _BLOCKS)
    middle = block_means(time, edges)
    turned = turning_against(time, orders * speed_rev_s)[..., None] * signal
    sums = np.add.reduceat(turned, edges, axis=1)
    weights = weights_of(orders, teeth)

    def energy(speed: float) -> float:
        slow = turning_against(middle, orders * (speed - speed_rev_s))
        return float(np.sum(np.abs(np.einsum("fb,fba->fa", slow, sums)) ** 2, axis=1) @ weights)

    return energy
