"""A trial's record compressed to what a steady force model can be fitted on, without loss.

The model's force is a sum of lines at multiples of the spindle frequency, y = B q with B the columns [1, cos
n th, sin n th] over the samples. The squared error is |y|^2 - 2 q.b + q.G q with b = B^T y and G = B^T B, so
(|y|^2, b, G) hold all a fit needs; with G = L L^T it is |z - L^T q|^2 + rest, z = L^-1 b. `rest` is what no
steady model can explain: noise, and lines that do not belong to the spindle. The folding of lines above half
the sampling rate is in B, so nothing is lost to it. Of many orders those that hold noise alone are not
followed (`followed`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from mjx_cutting.tracing.records.comb import folded_hz
from mjx_cutting.tracing.records.followed import followed_orders, without_far_orders
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.motor import spindle_speeds
from mjx_cutting.tracing.records.spindle import measured_speed, spindle_angle, spindle_speed, stated_speed
from mjx_cutting.tracing.records.turns import filtered_turns, reach, real_columns, turns
from mjx_cutting.trials.dataset import Dataset, Sensor, Trial

Array = NDArray[np.floating]
_RIDGE = 1e-9
_TOOTH_HARMONICS = 6
_MOST_ORDERS = 160
_SIZES = (8, 12, 16, 24, 32, 40, 48, 56, 64, 80, 96, 128, 160, 192, 224, 256, 320, 384, 512, 640, 800, 1000)
_UNFILTERED_HARMONICS = 48
_MOST_UNFILTERED = 256
_SAMPLES_PER_ORDER = 8
_MANY_ORDERS = 56
_INAUDIBLE = 100.0
_BESIDE = 1.5
PIECE = ", piece "


@dataclass(frozen=True, eq=False)
class Lines:
    """R cut trials as lines of P = 2 orders + 1 basis functions and A = 3 axes.

    Fields:
        files: names of the trials, or of their pieces.
        speed_rev_s: [R] estimated spindle speed.
        samples: [R] samples in the band-limited record.
        energy_n2: [R, A] sum of squares of the band-limited record.
        rest_n2: [R, A] the part of it that no line at a multiple of the spindle frequency explains.
        whitened: [R, P, A] z = L^-1 B^T y.
        factor: [R, P, P] L, lower triangular, with unit diagonal for orders outside the band.
        present: [R, P] 1 where the order lies in the band, or so near that it leaks into it.
        orders: highest order.
        band_hz: (low, high) band in which everything is measured.
        followed: [orders + 1] True for the orders that are followed; the others hold noise alone.
        dataset: whose cut trials these are the lines of.
        droop_rev_s_nm: about how far the motor gives way that swings within the turn, rev/s/(N m); 0 for
            one that turns evenly.
    """

    files: tuple[str, ...]
    speed_rev_s: Array
    samples: Array
    energy_n2: Array
    rest_n2: Array
    whitened: Array
    factor: Array
    present: Array
    orders: int
    band_hz: tuple[float, float]
    followed: NDArray[np.bool_]
    dataset: Dataset
    droop_rev_s_nm: float = 0.0

    @property
    def trials(self) -> int:
        """Number of trials R, or of their pieces."""
        return len(self.files)

    @property
    def whole_files(self) -> tuple[str, ...]:
        """Names of the trials, pieces of one counted once."""
        return tuple(dict.fromkeys(map(whole_file, self.files)))

    @property
    def owner(self) -> NDArray[np.int64]:
        """[R] place in `whole_files` of the trial that each is a piece of."""
        names = self.whole_files
        return np.array([names.index(whole_file(name)) for name in self.files])

    def noise_std_n(self) -> Array:
        """[A] standard deviation of what lies between the lines, N, over all trials."""
        freedom = np.maximum(self.samples - self.present.sum(axis=1), 1.0)
        return np.sqrt(self.rest_n2.sum(axis=0) / freedom.sum())


def whole_file(name: str) -> str:
    """Name of the trial that a piece is of, or its own."""
    return name.split(PIECE)[0]


def trusted_band(dataset: Dataset, band_hz: tuple[float, float] | None) -> tuple[float, float]:
    """Band in which model and measurement are compared, Hz.

    The one asked for, else up to the anti-alias filter's corner, else up to half the sampling rate.

    Raises:
        ValueError: the band is empty or reaches beyond half the sampling rate.
    """
    nyquist = 0.5 * dataset.sensor.sample_rate_hz
    if band_hz is None:
        alias = dataset.sensor.anti_alias
        return (0.0, nyquist if alias is None else min(alias.hz, nyquist))
    low, high = float(band_hz[0]), float(band_hz[1])
    if not 0.0 <= low < high <= nyquist:
        raise ValueError(
            f"band is {low:g} to {high:g} Hz; expected 0 <= low < high <= {nyquist:g} Hz, "
            "half the sampling rate"
        )
    return low, high


def band_limit(record: Array, rate_hz: float, band_hz: tuple[float, float]) -> Array:
    """[T, A] the record without what lies outside the band (ideal filter over the whole record)."""
    low, high = band_hz
    if low <= 0.0 and high >= 0.5 * rate_hz:
        return record
    frequency = np.fft.rfftfreq(len(record), 1.0 / rate_hz)
    keep = (frequency >= low) & (frequency <= high)
    return np.fft.irfft(np.fft.rfft(record, axis=0) * keep[:, None], n=len(record), axis=0)


def compress(
    dataset: Dataset,
    band_hz: tuple[float, float],
    about_rev_s: Array | None = None,
    like: Lines | None = None,
    every: bool = False,
) -> Lines:
    """Lines of every cut trial of the dataset.

    Arguments:
        about_rev_s: [R] speeds about which each trial's own is looked for, and no further than a stated one
            may err; default: wherever a motor that gives way may have left it (`spindle`).
        like: lines of which the same orders are followed, of the same motor; default those that are heard in
            the band, of one that turns evenly.
        every: whether every order of the band is, but those that fold into it; as where lines change along
            the path and hardly stand out.

    Raises:
        ValueError: no cut trial, or one too short to tell its lines apart.
    """
    trials = [trial for trial in dataset.trials if trial.kind == "cut"]
    if not trials:
        raise ValueError("the dataset has no cut trial; tracing needs at least one of kind 'cut'")
    levels, alias = dataset.tool.kind in LEVEL_KINDS, dataset.sensor.anti_alias
    if levels:
        speeds = np.array([measured_speed(trial) or stated_speed(trial) for trial in trials])
    elif about_rev_s is None:
        speeds = spindle_speeds(trials, dataset.tool, alias)
    else:
        pairs = zip(trials, about_rev_s, strict=True)
        speeds = np.array([spindle_speed(trial, dataset.tool.teeth, alias, float(f)) for trial, f in pairs])
    if like is not None:
        lines = _read(dataset, trials, speeds, band_hz, like.followed)
        return replace(lines, droop_rev_s_nm=like.droop_rev_s_nm)
    highest = 0 if levels else _highest_order(dataset, band_hz, float(speeds.min()))
    if every:
        highest = min(highest, int(band_hz[1] / float(speeds.min())))
        return _read(dataset, trials, speeds, band_hz, np.ones(highest + 1, bool))
    lines = _read(dataset, trials, speeds, band_hz, np.ones(highest + 1, bool))
    followed = _followed(lines, dataset)
    if np.array_equal(followed, lines.followed):
        return lines
    return _read(dataset, trials, speeds, band_hz, followed)


def _followed(lines: Lines, dataset: Dataset) -> NDArray[np.bool_]:
    """[orders + 1] the orders worth following, up to one of few sizes, so that what is compiled for one data
    set serves others; all, where they are not many."""
    if lines.orders < _MANY_ORDERS:
        return lines.followed
    low, high = lines.band_hz
    in_band = np.minimum(2.0 * (high - low) / dataset.sensor.sample_rate_hz, 1.0) * lines.samples
    noise = lines.rest_n2 / np.maximum(in_band - lines.present.sum(axis=1), 1.0)[:, None]
    energy = float(lines.energy_n2.sum())
    followed = followed_orders(lines.whitened, lines.present, noise, energy, dataset.tool.teeth)
    followed = without_far_orders(followed, lines.whitened, energy, _MOST_ORDERS)
    highest = int(np.flatnonzero(followed).max())
    size = next((size for size in _SIZES if size >= highest), lines.orders)
    return followed[: min(size, lines.orders) + 1]


def _read(
    dataset: Dataset,
    trials: Sequence[Trial],
    speeds: Array,
    band_hz: tuple[float, float],
    followed: NDArray[np.bool_],
) -> Lines:
    parts = [
        _one(trial, speed, followed, dataset.sensor, band_hz)
        for trial, speed in zip(trials, speeds, strict=True)
    ]
    energy, rest, whitened, factor, present, samples = (np.stack(part) for part in zip(*parts, strict=True))
    return Lines(
        files=tuple(trial.file for trial in trials),
        speed_rev_s=speeds,
        samples=samples.astype(float),
        energy_n2=energy,
        rest_n2=rest,
        whitened=whitened,
        factor=factor,
        present=present,
        orders=len(followed) - 1,
        band_hz=band_hz,
        followed=followed,
        dataset=dataset,
    )


def heard_turns(lines: Lines, trial: int, angle_rad: Array) -> NDArray[np.complexfloating]:
    """[T, orders + 1] exp(i n th) at the angles [T] of a trial, as the filter passes them, twice for n >= 1,
    nil out of the band."""
    heard = np.concatenate([[1.0], 2.0 * lines.present[trial][1::2]])
    return filtered_turns(angle_rad, lines.orders, lines.dataset.sensor).T * heard


def basis(angle_rad: Array, orders: int) -> Array:
    """[T, 2 orders + 1] columns 1, cos n th, sin n th for n = 1..orders, in that order of n."""
    return real_columns(turns(angle_rad, orders))


def order_of_columns(orders: int) -> NDArray[np.int64]:
    """[2 orders + 1] order of each column of `basis`."""
    return np.concatenate([[0], np.repeat(np.arange(1, orders + 1), 2)])


def _highest_order(dataset: Dataset, band_hz: tuple[float, float], slowest_rev_s: float) -> int:
    """Highest order that falls, or folds, into the band and passes the known anti-alias filter.

    Of a saw of many teeth the first harmonics of tooth passing are taken, where the records tell them apart.
    Without a filter all of them fold, and what a tooth does at entry and exit falls off slowly: as many are
    taken then as the records can tell apart.
    """
    sensor, of_teeth = dataset.sensor, _TOOTH_HARMONICS * dataset.tool.teeth
    wanted = max(of_teeth, int(band_hz[1] / slowest_rev_s))
    shortest = min(len(trial.time_s) for trial in dataset.trials if trial.kind == "cut")
    told_apart = shortest // _SAMPLES_PER_ORDER
    most = max(_MOST_ORDERS, min(of_teeth, told_apart))
    if sensor.anti_alias is None:
        most = max(most, min(_MOST_UNFILTERED, told_apart))
        # of a piece of a trial no more than it tells apart (`_one`)
        most = max(min(most, (shortest - 3) // 4), 1)
        wanted = max(wanted, min(_UNFILTERED_HARMONICS * dataset.tool.teeth, most))
    else:
        audible_hz = sensor.anti_alias.hz * _INAUDIBLE ** (1.0 / sensor.anti_alias.order)
        wanted = max(wanted, int(audible_hz / slowest_rev_s))
    order = np.arange(1, min(wanted, most) + 1)
    frequency = order * slowest_rev_s
    beside = _BESIDE + max(reach(trial) for trial in dataset.trials if trial.kind == "cut")
    heard = folded_hz(frequency, sensor.sample_rate_hz) <= band_hz[1] + beside * slowest_rev_s
    if sensor.anti_alias is not None:
        alias = sensor.anti_alias
        heard &= (frequency / alias.hz) ** alias.order < _INAUDIBLE
    highest = int(order[heard].max(initial=1))
    # in few sizes, so that what is compiled for one data set serves others
    return next((size for size in _SIZES if most >= size >= highest), most)


def _one(
    trial: Trial, speed: float, followed: NDArray[np.bool_], sensor: Sensor, band_hz: tuple[float, float]
) -> tuple[Array, Array, Array, Array, Array, int]:
    rate_hz = sensor.sample_rate_hz
    record = band_limit(trial.force_n, rate_hz, band_hz)
    columns = real_columns(filtered_turns(spindle_angle(trial, speed), len(followed) - 1, sensor))
    order = order_of_columns(len(followed) - 1)
    folded = folded_hz(order * speed, rate_hz)
    beside = (_BESIDE + reach(trial)) * speed
    in_band = (folded >= band_hz[0] - beside) & (folded <= band_hz[1] + beside)
    present = (in_band & followed[order]).astype(float)
    # the same filter as on the record: a line just outside the band leaks into it alike
    columns = band_limit(columns * present, rate_hz, band_hz)
    if len(record) <= 2 * present.sum():
        raise ValueError(
            f"{trial.file}: {len(record)} samples cannot tell {int(present.sum())} lines apart; "
            "give a longer trial or a narrower --band"
        )
    gram = columns.T @ columns + np.diag(np.where(present > 0, _RIDGE * len(record), 1.0))
    factor = np.linalg.cholesky(gram)
    whitened = solve_triangular(factor, columns.T @ record, lower=True)
    energy = np.sum(record**2, axis=0)
    rest = np.maximum(energy - np.sum(whitened**2, axis=0), 0.0)
    return energy, rest, whitened, factor, present, len(record)
