"""A trial as effects that change along it see it: where the tool was when, what the steady model leaves.

The lines of a whole trial do not hold such effects. Given the best steady model, its prediction splits into a
wave of the chip and one of the edge, on which they act (`slow_kinds`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.records.legs import Legs, legs_of, smoothed
from mjx_cutting.trials.dataset import AntiAlias, Trial, columns_to_process

_FEEDS_APART = 1.1
_KNOWN = 1.0
_INSTANT = 1e-6
_STRETCHES = 12
_AT_REST = 0.02
_WHITE = 4.0
_OF_THE_FED = 0.2
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Course:
    """One trial as the slow effects see it.

    Fields:
        time_s: [T] from its start.
        position_m: [T] along the path where what is sensed arose, `delay_s` before: measured or by the feed.
        feed_share: [T] measured feed over nominal, less one, held at no period; None where not measured.
        chip_n, edge_n: [T, 3] waves of the chip and the edge, N.
        left_n: [T, 3] measured less predicted, N.
        rate_hz, band_hz: sampling rate and the band compared.
        index: place among the cut trials; angle_rad: [T] angle of tooth 0 as fitted.
        alias: the known anti-alias filter; delay_s: by how much later what is slow is seen behind it.
        pitch_s: mean time from one tooth to the next; later: [T] by how much more of it the next one takes, a
            share, where the spindle is seen to slow down or speed up, else None.
        by_tooth: whether a chip is what was fed since the last tooth, or goes with the feed of the instant.
        apart: whether the steady model was fitted to records without what is looked for.
        chip_by_fold, edge_by_fold: [F, 3] those waves with each fold of trials left out, as shares of them.
        ahead_m: how far a tooth in the cut is ahead of the tool's centre, at least and at most.
        at_teeth: [K, 2, T, 3] complex waves of chip and edge whose teeth each turn with exp(i k x), of wave
            numbers k [K], rad/m, x the way from the middle of `ahead_m` to the tooth; None where not known.
        by_direction: [T, 3, 3] what the tangential, radial and axial force of the teeth have of it; None
            where not known.
        border_power: [3] what power of the way across a border of two layers the force along each axis goes
            with.
        beside_m: [T] measured place across the path, into the sheet, `delay_s` before; None where it was not
            measured, or is still.
        damped_n: [T, 3, 2] force of process damping of 1 N/m, of each tooth and of the tool as one, moving
            into the sheet at 1 m/s; None where not known.
    """

    time_s: Array
    position_m: Array
    feed_share: Array | None
    chip_n: Array
    edge_n: Array
    left_n: Array
    rate_hz: float
    band_hz: tuple[float, float]
    index: int = 0
    angle_rad: Array = field(default_factory=lambda: np.zeros(0))
    apart: bool = False
    delay_s: float = 0.0
    alias: AntiAlias | None = None
    pitch_s: float = 1e-3
    by_tooth: bool = True
    later: Array | None = None
    chip_by_fold: Array = field(default_factory=lambda: np.ones((0, 3)))
    edge_by_fold: Array = field(default_factory=lambda: np.ones((0, 3)))
    ahead_m: tuple[float, float] = (0.0, 0.0)
    at_teeth: Callable[[Sequence[float]], NDArray[np.complexfloating]] | None = None
    by_direction: Callable[[], Array] | None = None
    border_power: tuple[float, float, float] = (1.0, 1.0, 1.0)
    beside_m: Array | None = None
    damped_n: Callable[[], Array] | None = None

    @property
    def fed_over_s(self) -> float:
        """The time of which what is fed makes a chip, s."""
        return self.pitch_s if self.by_tooth else _INSTANT * self.pitch_s

    def without(self, fold: int) -> Course:
        """The trial under the steady model that was fitted without a fold."""
        share, at_teeth = np.stack([self.chip_by_fold[fold], self.edge_by_fold[fold]]), self.at_teeth
        chip_n, edge_n = self.chip_n * share[0], self.edge_n * share[1]
        of_teeth = None if at_teeth is None else lambda waves: at_teeth(waves) * share[:, None]
        by_direction, whole = self.by_direction, self._of_folds(1.0)[fold, :, None]
        turned = None if by_direction is None else lambda: by_direction() * whole
        return replace(self, chip_n=chip_n, edge_n=edge_n, at_teeth=of_teeth, by_direction=turned)

    def force(self, edge_share: float) -> Array:
        """[T, 3] force of the chip and of a share of the edge's, N; nil along an axis of which the fits with
        a fold left out do not agree even of what sign it is."""
        return np.where(self._known(edge_share), self.chip_n + edge_share * self.edge_n, 0.0)

    def force_at_teeth(self, waves: Sequence[float], edge_share: float) -> NDArray[np.complexfloating]:
        """[K, T, 3] the same, the teeth's shares turning with wave numbers [K], rad/m (`at_teeth`)."""
        assert self.at_teeth is not None
        found = self.at_teeth(waves)
        return np.where(self._known(edge_share), found[:, 0] + edge_share * found[:, 1], 0.0)

    def force_by_direction(self) -> Array:
        """[T, 3, 3] what the tangential, radial and axial force of the teeth have of the force, N; nil along
        an axis as `force` is."""
        assert self.by_direction is not None
        return np.where(self._known(1.0)[:, None], self.by_direction(), 0.0)

    def _known(self, edge_share: float) -> NDArray[np.bool_]:
        """[3] the axes along which the fits with a fold left out agree."""
        by_fold = self._of_folds(edge_share)
        if not len(by_fold):
            return np.ones(3, dtype=bool)
        error = np.sqrt((len(by_fold) - 1) * np.var(by_fold, axis=0))  # jackknife
        return np.asarray(error < _KNOWN)

    def _of_folds(self, edge_share: float) -> Array:
        """[F, 3] the force with each fold of trials left out, as a share of it."""
        edge_n = edge_share * self.edge_n
        whole = self.chip_n + edge_n
        energy = np.maximum(np.sum(whole**2, axis=0), 1e-300)
        of_chip, of_edge = (np.sum(whole * part, axis=0) / energy for part in (self.chip_n, edge_n))
        return np.asarray(self.chip_by_fold * of_chip + self.edge_by_fold * of_edge)

    def own(self, columns: Array) -> Array:
        """[T, 3, k] columns without what chip, edge and zero of this trial can imitate, where they did."""
        if self.apart:
            return columns
        flat = columns.reshape(-1, columns.shape[-1])
        return (flat - self.same @ (self.same.T @ flat)).reshape(columns.shape)

    @cached_property
    def way_m(self) -> Array:
        """[T] position as felt, m, which stays where it is until the filter lets the beginning through."""
        start = float(np.interp(self.delay_s, self.time_s, self.position_m))
        return np.where(self.time_s < self.delay_s, start, self.position_m)

    @cached_property
    def legs(self) -> Legs:
        """How the tool goes along its path."""
        return legs_of(self.way_m)

    @cached_property
    def legs_beside(self) -> Legs | None:
        """How it goes across the path; None where that was not measured."""
        return None if self.beside_m is None else legs_of(self.beside_m)

    @cached_property
    def same(self) -> Array:
        """[3 T, 5] orthonormal span of a change of the chip's force, of the edge's, of the three zeros."""
        zero = np.zeros((*self.chip_n.shape, 3))
        zero[:, range(3), range(3)] = 1.0
        span = np.concatenate([self.chip_n[..., None], self.edge_n[..., None], zero], axis=-1).reshape(-1, 5)
        left, size, _ = np.linalg.svd(
            span / np.maximum(np.linalg.norm(span, axis=0), 1e-12), full_matrices=False
        )
        return left * (size > 1e-6 * size[0])


def rate_hz(trial: Trial) -> float:
    """Samples a second of a record, Hz."""
    return (len(trial.time_s) - 1) / float(trial.time_s[-1] - trial.time_s[0])


def along_path(trial: Trial) -> Array:
    """[T] position along the path, m: the measured axis that moves most, or the feed's integral from zero. A
    place that is off an even feed by white noise alone is that of the even feed."""
    axis = path_axis(trial)
    if trial.position_m is not None and axis is not None:
        place = _evened(trial.time_s, trial.position_m[:, axis])
        return place if _goes_up(place) else -place
    time = trial.time_s - trial.time_s[0]
    if trial.feed_speed_measured_m_s is not None:
        step = np.diff(time, prepend=time[0])
        return np.cumsum(trial.feed_speed_measured_m_s * step)
    return trial.feed_speed_m_s * time


def path_axis(trial: Trial) -> int | None:
    """The measured axis that moves most; None where no place was measured, or only one beside the path, which
    moves by far less than was fed."""
    if trial.position_m is None:
        return None
    moved = np.ptp(trial.position_m, axis=0)
    fed = trial.feed_speed_m_s * float(trial.time_s[-1] - trial.time_s[0])
    beside_only = np.count_nonzero(moved) < len(moved) and moved.max() < _OF_THE_FED * fed
    return None if beside_only else int(np.argmax(moved))


def _evened(time_s: Array, place: Array) -> Array:
    """A place [T] at an even feed where all it is off by is the white noise of an encoder; else as it is."""
    even = np.polynomial.Polynomial.fit(time_s, place, 1)(time_s)
    off = place - even
    beside = float(np.sum(off[1:] * off[:-1])) / max(float(np.sum(off**2)), 1e-300)
    return even if np.any(off) and abs(beside) < _WHITE / np.sqrt(len(off)) else place


def _goes_up(place: Array) -> bool:
    """Whether a place [T] goes up for most of the time in which it moves: in the end a tool may be withdrawn
    beyond where it began."""
    means = [part.mean() for part in np.array_split(place, min(_STRETCHES, len(place)))]
    step = np.diff(means)
    moves = step[np.abs(step) > _AT_REST * np.max(np.abs(step), initial=0.0)]
    up = int(np.sum(np.sign(moves)))
    return up > 0 if up else bool(place[-1] >= place[0])


def felt_at(trial: Trial, delay_s: float) -> Array:
    """[T] position along the path, m, a while before each sample; as if the trial had begun sooner."""
    place, time = along_path(trial), trial.time_s
    sooner = np.interp(time - delay_s, time, place)
    before = time - delay_s < time[0]
    sooner[before] = place[0] - trial.feed_speed_m_s * (delay_s - (time[before] - time[0]))
    return sooner


def beside_path(trial: Trial, axes: Sequence[str] | None, delay_s: float) -> Array | None:
    """[T] measured place across the path, into the sheet (+y), m, a while before each sample; None where it
    was not measured, is still, or is the path. `axes` as of the dataset."""
    if trial.position_m is None:
        return None
    across, axis = columns_to_process(trial.position_m, axes)[:, 1], path_axis(trial)
    is_path = axis is not None and columns_to_process(np.eye(3)[axis], axes)[1] != 0.0
    if is_path or np.ptp(across) == 0.0:
        return None
    return np.interp(trial.time_s - delay_s, trial.time_s, smoothed(across))


def feeds_differ(feeds_m_s: Sequence[float]) -> bool:
    """Whether a place on the path is reached after different times, so that the two can be told apart."""
    return max(feeds_m_s, default=0.0) > _FEEDS_APART * min(feeds_m_s, default=0.0)


def at_several_feeds(courses: Sequence[Course]) -> bool:
    """Whether the feeds that were driven differ as `feeds_differ` asks."""
    spans = [(float(np.ptp(each.position_m)), float(np.ptp(each.time_s))) for each in courses]
    return feeds_differ([way / max(time, 1e-9) for way, time in spans])
