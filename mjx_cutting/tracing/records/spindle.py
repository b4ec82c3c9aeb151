"""The true spindle speed of every trial, found from the force records.

A cut repeats every revolution, so its energy stands at multiples of the spindle frequency f. The speed is the
f within `SPREAD` of the nominal that collects the most energy at its multiples; the error of that estimate
falls as T^(-3/2) (Rife and Boorstyn, IEEE Trans. Inf. Theory 20 (1974) 591-598). Lines above half the
sampling rate are looked for where they fold to, but no line counts more than a known filter could have let
through: a strong one of the spindle's own order may stand where tooth passing of another speed folds to.
Where the spindle angle was measured, it is used and nothing is estimated. Where a measured speed changes
within the record, the multiples are those of the angle that it integrates to (`even_time`).

A motor that gives way under load runs several per cent slow. No trial is searched that far by itself: many
combs share lines (with N teeth, one N / (N + 1) as fast holds tooth passing too, at order N + 1; a sampled
one may mirror another). The session is searched for ONE motor instead: f = f_0 - c A / f - e B, with A and B
what geometry says of the torque of chip and edge, and every trial within `SPREAD` of it. The nominal speeds
are left only where that law collects clearly more energy over the session.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.optimize import nnls

from mjx_cutting.cutting import arc
from mjx_cutting.tracing.records.blocks import block_edges, block_means
from mjx_cutting.tracing.records.course import rate_hz
from mjx_cutting.tracing.records.even_time import even_time, from_start
from mjx_cutting.tracing.records.line_gain import filter_gain
from mjx_cutting.trials.dataset import AntiAlias, Dataset, ToolInfo, Trial

Array = NDArray[np.floating]
SPREAD = 0.01
SLOWEST = 0.35
_LAW_OFF = 1.3
_OF_A_TOOTH = 0.5
_PAD = 8
_TOOTH_HARMONICS = 4
_REFINED = 12
_BLOCKS = 1024
_RESOLVED = 2.5
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
_LOSS_STEP = 0.004
_EDGE_SHARES = np.linspace(0.0, 0.9, 10)
_BETWEEN_TEETH = 0.6
_OVER_NOISE = 10.0
_CLEARLY_TRIALS = 1.0
_MOST_OF_A_LINE = 2.0
_SLOW = 0.5


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
    signal, time = _windowed(trial)
    if not signal.any():
        return middle
    orders = _orders(trial, teeth)
    candidates, step = _candidates(middle, spread, spread, time, orders)
    most = _most_power(trial, orders * middle, alias)
    power = np.minimum(_coarse_power(signal, time, orders, candidates, teeth), most)
    best = float(candidates[int(np.argmax(power @ _weights(orders, teeth)))])
    strength = _comb(signal, time, orders, best, teeth, most) * _standing_alone(time, orders, best)
    strongest = orders[np.argsort(strength)[-_REFINED:]]
    strongest = strongest[np.sort(strength)[-_REFINED:] > 0.0]
    # the coarse spectrum cannot place the peak better than a bin of its strongest line
    bin_rev_s = 1.0 / (_PAD * time[-1] * orders[int(np.argmax(strength))])
    near = best + step * np.arange(-int(bin_rev_s / step) - 1, int(bin_rev_s / step) + 2)
    energy = _energy_near(signal, time, strongest, best, teeth)
    return _refine(energy, float(near[int(np.argmax([energy(float(each)) for each in near]))]), step)


def spindle_speeds(trials: Sequence[Trial], tool: ToolInfo, alias: AntiAlias | None) -> Array:
    """[R] speeds of the cut trials of a session behind a filter that is known, if any, rev/s, the motor's
    giving way looked for."""
    stated = np.array([stated_speed(trial) for trial in trials])
    about = loaded_speeds(trials, tool, alias)
    found = _about(trials, tool.teeth, alias, about)
    if np.array_equal(about, stated):
        return found
    # the law's grid is coarse: once more, about the motor that fits what was found
    chip, edge = _all_loads(trials, tool)
    columns = np.stack([chip / found, edge, stated, -stated], axis=1)
    weights, _ = nnls(columns, stated - found)
    # what the law says is off too; but many teeth leave no room before the comb of one tooth more
    spread = max(SPREAD, min(_LAW_OFF * SPREAD, _OF_A_TOOTH / tool.teeth))
    return _about(trials, tool.teeth, alias, stated - columns @ weights, spread)


def _about(
    trials: Sequence[Trial],
    teeth: int,
    alias: AntiAlias | None,
    middle_rev_s: Array,
    spread: float = SPREAD,
) -> Array:
    pairs = zip(trials, middle_rev_s, strict=True)
    return np.array([spindle_speed(trial, teeth, alias, float(f), spread) for trial, f in pairs])


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
    speed, orders = spindle_speed(trial, teeth, alias), _orders(trial, teeth)
    most = _most_power(trial, orders * speed, alias)
    return float(np.sum(_comb(*_windowed(trial), orders, speed, teeth, most)))


def loaded_speeds(trials: Sequence[Trial], tool: ToolInfo, alias: AntiAlias | None) -> Array:
    """[R] stated speeds, or those of the motor that gives way whose combs collect clearly more energy.

    Energy is counted in trials: one whose comb holds all it can counts 1.
    """
    stated = np.array([stated_speed(trial) for trial in trials])
    if any(trial.spindle_angle_rad is not None for trial in trials) or len(trials) < 3:
        return stated
    chip, edge = _all_loads(trials, tool)
    found = [_within_reach(trial, tool.teeth, alias) for trial in trials]
    if not np.all(chip > 0.0) or any(one is None for one in found):
        return stated

    def collected(speeds: Array) -> float:
        return sum(float(np.interp(f, *one)) for f, one in zip(speeds, found, strict=True) if one)

    heaviest = int(
        np.argmax(chip / stated**2 / np.median(chip / stated**2) + edge / stated / np.median(edge))
    )
    best, most = stated, collected(stated)
    at_rest = most
    for loss in np.arange(_LOSS_STEP, SLOWEST - SPREAD, _LOSS_STEP):
        slowed = stated[heaviest] * (1.0 - loss)
        for share in _EDGE_SHARES:
            lost = loss * stated[heaviest]
            c, e = (1.0 - share) * lost * slowed / chip[heaviest], share * lost / edge[heaviest]
            left = stated - e * edge
            inner = left**2 - 4.0 * c * chip
            if np.any(inner <= 0.0) or np.any(left <= 0.0):
                continue
            speeds = 0.5 * (left + np.sqrt(inner))
            energy = collected(speeds)
            if energy > most:
                best, most = speeds, energy
    return best if most > at_rest + _CLEARLY_TRIALS else stated


def _all_loads(trials: Sequence[Trial], tool: ToolInfo) -> tuple[Array, Array]:
    chip, edge = zip(*(_loads(trial, tool) for trial in trials), strict=True)
    return np.array(chip), np.array(edge)


def _loads(trial: Trial, tool: ToolInfo) -> tuple[float, float]:
    """Geometry's part of the mean torque: of the chip, times the speed, and of the edge."""
    depth = tool.diameter_m if trial.milling == "slot" else trial.radial_depth_m
    entry, exit_ = arc(trial.milling or "slot", trial.radial_depth_m, tool.diameter_m)
    chip = depth * trial.axial_width_m * trial.feed_speed_m_s
    return chip, trial.axial_width_m * float(exit_ - entry)


def _within_reach(trial: Trial, teeth: int, alias: AntiAlias | None) -> tuple[Array, Array] | None:
    """Speeds down to `SLOWEST` below the stated one, and the energy of the best comb within `SPREAD` of each.

    Energy is counted from the usual one of all speeds and in units of the best. A line between tooth passing
    counts less, because a comb that holds the tooth lines at other orders is a wrong one.
    """
    signal, time = _windowed(trial)
    if not signal.any():
        return None
    orders = _orders(trial, teeth)
    stated = stated_speed(trial)
    candidates, step = _candidates(stated, SLOWEST, 2.0 * SPREAD, time, orders)
    most = _most_power(trial, orders * stated, alias)
    power = np.minimum(_coarse_power(signal, time, orders, candidates, teeth), most)
    # by the logarithm, so that many lines in their places say more than one strong line
    heard = np.log1p(power / (_OVER_NOISE * np.median(power))) @ _weights(orders, teeth)
    energy = np.maximum(heard - np.median(heard), 0.0)
    reach = max(int(SPREAD * stated / step), 1)
    best = maximum_filter1d(energy, 2 * reach + 1, mode="constant")
    return candidates, best / max(float(best.max()), 1e-300)


def _windowed(trial: Trial) -> tuple[Array, Array]:
    """The record as an even spindle would have shown it, windowed so that a strong line does not leak onto
    the place of a weak one; its times."""
    signal, time = trial.signals[:, ~np.isnan(trial.signals).any(axis=0)], from_start(trial)
    even = even_time(trial)
    if even is not None:
        signal = np.stack([np.interp(time, even, each) for each in signal.T], axis=-1)
    return (signal - signal.mean(axis=0)) * np.hanning(len(signal))[:, None], time


def _candidates(
    middle: float, below: float, above: float, time: Array, orders: NDArray[np.int64]
) -> tuple[Array, float]:
    """Speeds from `below` to `above` the middle, shares of it, as finely as the highest order tells apart."""
    step = 1.0 / (_PAD * time[-1] * orders[-1])
    counts = [int(np.ceil(share * middle / step)) for share in (below, above)]
    return middle + step * np.arange(-counts[0], counts[1] + 1), step


def _orders(trial: Trial, teeth: int) -> NDArray[np.int64]:
    """Tooth passing and its harmonics, and those spindle orders that do not fold.

    A folded spindle order could stand where tooth passing of another speed does; tooth passing itself is too
    strong to leave out.
    """
    low = np.arange(1, teeth * _TOOTH_HARMONICS + 1)
    unfolded = low * trial.spindle_speed_rev_s * (1.0 + SPREAD) < 0.5 * rate_hz(trial)
    return low[unfolded | (low % teeth == 0)]


def _weights(orders: NDArray[np.int64], teeth: int) -> Array:
    """[F] tooth passing counts 1, its harmonic k as 1 / k, since that much weaker it is and folds anywhere;
    lines between count less than tooth passing, or a comb that holds it at another order would pass."""
    return np.where(orders % teeth == 0, teeth / orders, _BETWEEN_TEETH)


def _coarse_power(
    signal: Array, time: Array, orders: NDArray[np.int64], candidates: Array, teeth: int
) -> Array:
    """[C, F] energy at the orders of each candidate speed, read from a zero-padded spectrum."""
    interval = (time[-1] - time[0]) / (len(time) - 1)
    length = int(2 ** np.ceil(np.log2(_PAD * len(time))))
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
        close = np.abs(folded_hz - folded_hz[:, index : index + 1]) < _RESOLVED / span_s
        heard[close & (~is_tooth | (orders > orders[index]))] = 0.0
    return heard


def _slow(folded_hz: Array, candidates: Array, orders: NDArray[np.int64], teeth: int) -> NDArray[np.bool_]:
    """[C, F] the harmonics of tooth passing that fold to where the force itself changes slowly, by layers or
    at the ends of the cut, while tooth passing does not: it tells the speed without them."""
    slow = folded_hz < _SLOW * candidates[:, None]
    passing = slow[:, orders == teeth]
    return slow & (orders % teeth == 0) & (orders > teeth) & ~passing


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
    turned = _wave(time, orders * speed_rev_s)[..., None] * signal
    sums = np.add.reduceat(turned, edges, axis=1)
    weights = _weights(orders, teeth)

    def energy(speed: float) -> float:
        slow = _wave(middle, orders * (speed - speed_rev_s))
        return float(np.sum(np.abs(np.einsum("fb,fba->fa", slow, sums)) ** 2, axis=1) @ weights)

    return energy


def _comb(
    signal: Array,
    time: Array,
    orders: NDArray[np.int64],
    speed_rev_s: float,
    teeth: int,
    most: Array,
) -> Array:
    """[F] exact energy of the record at each order of a speed, weighted; of each no more than `most` [F]."""
    wave = _wave(time, orders * speed_rev_s)
    return np.minimum(np.sum(np.abs(wave @ signal) ** 2, axis=1), most) * _weights(orders, teeth)


def _most_power(trial: Trial, frequency_hz: Array, alias: AntiAlias | None) -> Array:
    """[F] the most that a line of a frequency can hold of the windowed record, behind a filter that is known:
    as many times what would be if all of the force were one wave there."""
    force = trial.signals[:, ~np.isnan(trial.signals).any(axis=0)]
    wave = 0.5 * len(force) * np.sqrt(0.5 * np.sum(np.mean(force**2, axis=0)))
    return (_MOST_OF_A_LINE * wave * np.abs(filter_gain(alias, frequency_hz))) ** 2


def _wave(time: Array, frequency_hz: Array) -> NDArray[np.complexfloating]:
    """[F, T] a turn against each frequency."""
    return np.asarray(np.exp(-2j * np.pi * np.multiply.outer(frequency_hz, time)))


def _standing_alone(time: Array, orders: NDArray[np.int64], speed_rev_s: float) -> Array:
    """[F] 1 for the orders whose lines no other comes near after sampling; all, where there is no such."""
    frequency, rate_hz = orders * speed_rev_s, (len(time) - 1) / time[-1]
    folded = np.abs(frequency - rate_hz * np.round(frequency / rate_hz))
    near = np.abs(np.subtract.outer(folded, folded)) < _RESOLVED / time[-1]
    alone = (near.sum(axis=1) == 1).astype(float)
    return alone if alone.any() else np.ones(len(orders))
