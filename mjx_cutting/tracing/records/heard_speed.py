"""How a spindle turned within a record, heard in the force where nothing measured it.

No spindle turns evenly: its speed wanders by some parts in ten thousand within seconds, and the angle with
it, by so much that the harmonics of tooth passing lose step within one record. Turned back by an even speed,
line k of tooth passing then moves in phase alone, by k times as much as the first. So the slow curve of the
angle is the one under which all of them stand still together.

A force that grows and shrinks moves no phase, and what is not of the spindle moves that of each line in its
own way, and its size: a mode of the sheet that changes along the path, say. So the curve is believed where
the lines agree on it and then stand still, where phases move far more than sizes do, where it is slow, and
where it is beyond chance and more than a calculation of the force may be off.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray
from scipy import stats

from mjx_cutting.tracing.records.comb import SPREAD, folded_hz, standing_alone, turning_against
from mjx_cutting.tracing.records.even_time import even_time, from_start
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.motor import spindle_speeds
from mjx_cutting.tracing.records.spindle import stated_speed
from mjx_cutting.trials.dataset import Dataset, Trial

_HARMONICS = 6
_MOST = 16
_TURNS_PER_TERM = 4
_FEWEST_TURNS = 12
_STEPS = 12
_HEARD = 0.02
_SLOW = 1.5
_WORTH = 8.0
_SURELY = 1e-6
_LEAST = 3e-3
_AGREE = 0.95
_STILL = 0.9
_ONLY_PHASE = 10.0
_PITCHES = 6
_SAMPLES = 4.0
Array = NDArray[np.floating]
Complex = NDArray[np.complexfloating]


def as_heard(dataset: Dataset) -> Dataset:
    """The data set, its cuts with the speed that the force says they turned at, where it surely changes
    within the record and was not measured, or not seen to change. Its mean stays what was stated. Nothing is
    heard of a motor that gives way under load: how its speed follows that is read otherwise (`droop`); nor,
    where no filter is known, what samples that drift along sharp edges would look like."""
    if dataset.tool.kind in LEVEL_KINDS:
        return dataset
    cuts = [trial for trial in dataset.trials if trial.kind == "cut"]
    if not cuts:
        return dataset
    speeds = spindle_speeds(cuts, dataset.tool, dataset.sensor.anti_alias)
    if any(speed < (1.0 - SPREAD) * stated_speed(trial) for speed, trial in zip(speeds, cuts, strict=True)):
        return dataset
    rest, sharp = iter(speeds), dataset.sensor.anti_alias is None
    trials = [
        _heard(trial, dataset.tool.teeth, float(next(rest)), sharp) if trial.kind == "cut" else trial
        for trial in dataset.trials
    ]
    return replace(dataset, trials=tuple(trials))


def _heard(trial: Trial, teeth: int, speed_rev_s: float, sharp: bool) -> Trial:
    if trial.spindle_angle_rad is not None or even_time(trial) is not None:
        return trial
    change = speed_change(trial, teeth, speed_rev_s)
    if change is None or (sharp and _of_the_samples(change, trial, teeth, speed_rev_s)):
        return trial
    heard = np.asarray(stated_speed(trial) * (1.0 + change), dtype=np.float64)
    return replace(trial, spindle_speed_measured_rev_s=heard)


def _of_the_samples(change: Array, trial: Trial, teeth: int, speed_rev_s: float) -> bool:
    """Whether a change of speed [T] may be how samples go along sharp edges, which are met by the sample
    before them or by the one behind. Where q pitches last nearly a whole number of samples, the samples drift
    slowly along the edges, which seem to come sooner or later by the q-th part of one and somewhat more."""
    time = from_start(trial)
    rate_hz, passing_hz = (len(time) - 1) / time[-1], teeth * speed_rev_s
    ahead_s = np.cumsum(change) / rate_hz
    pitches = np.arange(1, _PITCHES + 1)
    drift = pitches * rate_hz / passing_hz
    swings = np.abs(drift - np.round(drift)) * passing_hz * time[-1]
    return bool(np.any((swings < 0.5 * _MOST) & (np.ptp(ahead_s) < _SAMPLES / (pitches * rate_hz))))


def speed_change(trial: Trial, teeth: int, speed_rev_s: float) -> Array | None:
    """[T] by what share the spindle turns faster than on the mean, slow against a turn; None where that is
    not heard.

    Arguments: the trial; number of teeth; its mean speed, rev/s.
    """
    time = from_start(trial)
    turns = int(speed_rev_s * time[-1])
    signal = trial.force_n[:, ~np.isnan(trial.force_n).any(axis=0)]
    if turns < _FEWEST_TURNS or not np.ptp(signal):
        return None
    lines = _Lines.of(time, signal - signal.mean(axis=0), teeth, speed_rev_s, turns)
    if not len(lines.order):
        return None
    most = min(_MOST, turns // _TURNS_PER_TERM)
    term = np.arange(1, most + 1)
    way = 2.0 * lines.time / time[-1] - 1.0
    # a mean speed that is a little off makes a straight line, which is not of the curve; nor is a mean angle
    basis = np.column_stack([way, _ahead(way, term)])
    basis -= basis.mean(axis=0)
    settled = (lines.settled(basis, start) for start in lines.starts(basis))
    value = max(settled, key=lambda value: lines.energy(basis @ value))
    basis, value = lines.of_fewest(basis, value)
    term = term[: len(value) - 1]
    force_n2 = len(basis) * float(np.mean(np.sum(signal**2, axis=1)))
    # what takes as many terms as are allowed at most is not slow
    if not 0 < len(term) < _MOST or not lines.believed(basis, value, force_n2):
        return None
    faster = legvander(2.0 * time / time[-1] - 1.0, term[-1])[:, term] * (2.0 * (2 * term + 1) / time[-1])
    return np.asarray(faster @ value[1:] / (2.0 * np.pi * speed_rev_s))


def _ahead(way: Array, term: NDArray[np.int64]) -> Array:
    """[B, M] the integral of Legendre's polynomial of each degree n of `term` [M], from 1 on, times 2 n + 1:
    nil at both ends of the way, -1 and 1."""
    each = legvander(way, term[-1] + 1)
    return np.asarray(each[:, term + 1] - each[:, term - 1])


@dataclass(frozen=True, eq=False)
class _Lines:
    """Lines of tooth passing turned back by an even speed, turn by turn.

    Fields: `time` [B] middle of each turn, s; `order` [K] of the lines heard; `wave` [K, B, A] what each is
    in each turn, N.
    """

    time: Array
    order: NDArray[np.int64]
    wave: Complex

    @classmethod
    def of(cls, time: Array, signal: Array, teeth: int, speed_rev_s: float, turns: int) -> _Lines:
        """Of a record [T, A] over its whole turns."""
        order = teeth * np.arange(1, _HARMONICS + 1)
        # a harmonic that folds to where the force itself changes slowly tells nothing of the spindle
        folded = folded_hz(order * speed_rev_s, (len(time) - 1) / time[-1])
        alone = standing_alone(time, order, speed_rev_s, teeth) > 0.0
        order = order[alone & (folded > _SLOW * speed_rev_s)]
        edges = np.searchsorted(time, np.arange(turns + 1) / speed_rev_s)
        turned = turning_against(time, order * speed_rev_s)[..., None] * signal
        sums = np.add.reduceat(turned[:, : edges[-1]], edges[:-1], axis=1)
        wave = sums / np.diff(edges)[:, None]
        # noise is not alike from one turn to the next
        alike = np.abs(np.sum(wave[:, 1:] * wave[:, :-1].conj(), axis=(1, 2)))
        loud = alike > _HEARD**2 * alike.max(initial=0.0)
        return cls((np.arange(turns) + 0.5) / speed_rev_s, order[loud], wave[loud])

    def starts(self, basis: Array) -> list[Array]:
        """[M] parts of a curve to begin from: none, and what each line does from turn to turn."""
        found: list[Array] = [np.zeros(basis.shape[1])]
        for order, wave in zip(self.order, self.wave, strict=True):
            step = np.angle(np.sum(wave[1:] * wave[:-1].conj(), axis=1))
            angle = np.concatenate([[0.0], np.cumsum(step)]) / order
            found.append(np.linalg.lstsq(basis, angle - angle.mean(), rcond=None)[0])
        return found

    def energy(self, angle: Array) -> float:
        """Energy of the lines, over the turns, that stands still under an angle [B], N^2."""
        return len(angle) * float(np.sum(np.abs(self._still(angle).mean(axis=1)) ** 2))

    def settled(self, basis: Array, value: Array) -> Array:
        """[M] parts of the curve near `value` under which most of the lines stands still."""
        reached, square = self.energy(basis @ value), basis.T @ basis
        for _ in range(_STEPS):
            size, moved = self._moved(basis @ value)
            toward = np.sum((size**2 * self.order)[:, None] * moved, axis=0) @ basis
            told = float(np.sum((size * self.order) ** 2))
            step = np.linalg.lstsq(told * square, toward, rcond=None)[0]
            after = self.energy(basis @ (value + step))
            if after <= reached:
                break
            value, reached = value + step, after
        return value

    def of_fewest(self, basis: Array, value: Array) -> tuple[Array, Array]:
        """The first columns of `basis` [B, M], and the parts of the curve near `value` [M] that they make,
        beyond which more of them gain no more than noise does."""
        scatter, tried = self._scatter(basis, value), []
        for count in range(1, len(value) + 1):
            first = basis[:, :count]
            closest = np.linalg.lstsq(first, basis @ value, rcond=None)[0]
            found = self.settled(first, closest)
            tried.append((self.energy(first @ found) - _WORTH * count * scatter, first, found))
        _, first, found = max(tried, key=lambda each: each[0])
        return first, found

    def _scatter(self, basis: Array, value: Array) -> float:
        """What one of the phases scatters by about slow curves of each line's own, N^2."""
        size, moved = self._moved(basis @ value)
        free = max(moved.size - len(self.order) * len(value), 1)
        return float(np.sum(_rest(basis, size, moved) ** 2)) / free

    def believed(self, basis: Array, value: Array, force_n2: float) -> bool:
        """Whether the lines move as the curve says, where the squares of the force sum to `force_n2` over the
        turns."""
        parts, lines, straight = len(value) - 1, len(self.order), basis[:, :1]
        reached = self.energy(basis @ value)
        gained = reached - self.energy(straight @ self.settled(straight, np.zeros(1)))
        scatter = self._scatter(basis, value)
        free = max(lines * (len(basis) - len(value)), 1)
        by_chance = stats.f.sf(gained / max(parts * scatter, 1e-300), parts, free)
        # a wave c exp(i n th) and its conjugate hold 2 |c|^2
        if by_chance > _SURELY or 2.0 * gained < _LEAST**2 * force_n2:
            return False
        size, moved = self._moved(basis @ value)
        own = np.sum((size[:, None] * moved) ** 2 - _rest(basis, size, moved) ** 2)
        apart = float(own) - scatter * lines * len(value)
        grown = np.abs(self._onto(basis @ value)) - 1.0
        slow = float(np.sum((size[:, None] * grown) ** 2 - _rest(basis, size, grown) ** 2))
        return (
            gained > _AGREE * (gained + max(apart, 0.0))
            and gained > _ONLY_PHASE * slow
            and reached > _STILL * float(np.sum(np.abs(self.wave) ** 2))
        )

    def _still(self, angle: Array) -> Complex:
        """[K, B, A] the lines turned back by an angle [B] besides."""
        return np.asarray(self.wave * np.exp(-1j * self.order[:, None] * angle)[..., None])

    def _onto(self, angle: Array) -> Complex:
        """[K, B] each line in each turn, as a share of its mean under an angle [B]."""
        still = self._still(angle)
        mean = still.mean(axis=1, keepdims=True)
        return np.asarray(
            np.sum(still * mean.conj(), axis=2) / np.maximum(np.sum(np.abs(mean) ** 2, axis=2), 1e-300)
        )

    def _moved(self, angle: Array) -> tuple[Array, Array]:
        """Size [K] of each line, N, and its phase [K, B] in each turn, rad, under an angle [B]."""
        size = np.sqrt(np.sum(np.abs(self._still(angle).mean(axis=1)) ** 2, axis=1))
        return size, np.angle(self._onto(angle))


def _rest(basis: Array, size: Array, moved: Array) -> Array:
    """[K, B] what a slow curve of its own leaves of what each line does, N."""
    orthonormal = np.linalg.qr(basis)[0]
    return np.asarray(size[:, None] * (moved - moved @ orthonormal @ orthonormal.T))
