"""A trial within which a tooth breaks: two, one with the teeth as they were and one with a tooth gone.

The lines of the whole trial are a mean of both, which no model with or without the tooth has. Where the teeth
become unlike at one place of the session (`naming.onset`), read block by block of a few turns, and that place
lies within a trial, the trial is parted there: at the sample that leaves least to the waves of before and
after, less a turn on either side.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.naming.onset import broken_between
from mjx_cutting.tracing.records.course import along_path, rate_hz
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import basis
from mjx_cutting.tracing.records.part import part_of
from mjx_cutting.tracing.records.spindle import spindle_angle, spindle_speed
from mjx_cutting.trials.dataset import AntiAlias, Dataset, LeftOut, Trial

_TURNS = 6
_SAMPLES_PER_LINE = 3
_FEWEST_TURNS = 8
_HARMONICS = 2
_UNFOLDED = 0.45
_BESIDE = 0.7
_IN_AIR = 0.3
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class _Turned:
    """A cut trial as it turned.

    Fields:
        angle_rad, way_m: [T] of the spindle and along the path.
        order: [L] orders of its lines: those that do not fold at half the sampling rate, and tooth passing.
        between: [L] True where a line tells teeth apart and none that folds lies upon it.
    """

    trial: Trial
    angle_rad: Array
    way_m: Array
    order: NDArray[np.int64]
    between: NDArray[np.bool_]

    def blocks(self) -> list[slice]:
        """Stretches of a few turns, those in air left out."""
        turns = float(np.ptp(self.angle_rad)) / (2.0 * np.pi)
        enough = _SAMPLES_PER_LINE * (2 * len(self.order) + 1)
        count = max(int(np.minimum(turns / _TURNS, len(self.angle_rad) / enough)), 1)
        edges = np.linspace(0, len(self.angle_rad), count + 1).astype(int)
        found = [slice(int(first), int(last)) for first, last in pairwise(edges)]
        size = np.array([np.sqrt(np.mean(self.trial.force_n[each] ** 2)) for each in found])
        return [each for each, one in zip(found, size, strict=True) if one > _IN_AIR * size.max()]

    def columns(self, part: slice) -> Array:
        """[T, 2 L + 1] one, then cosine and sine of every order over a part of the record."""
        whole = basis(self.angle_rad[part], int(self.order.max()))
        return whole[:, np.concatenate([[0], np.stack([2 * self.order - 1, 2 * self.order], axis=1).ravel()])]

    def lines(self, part: slice) -> Array:
        """[2 L + 1, 3] of the force over a part of the record, N."""
        return np.asarray(np.linalg.lstsq(self.columns(part), self.trial.force_n[part], rcond=None)[0])

    def apart(self, part: slice) -> float:
        """Size of the lines that tell teeth apart, over that of the others."""
        line, between = self.lines(part), np.concatenate([[False], np.repeat(self.between, 2)])
        size = float(np.linalg.norm(line[between]))
        return size / max(float(np.linalg.norm(line[~between])), 1e-300)

    def length_m(self, sample: int) -> float:
        """Length cut with the tool up to a sample, m."""
        way_m = float(self.way_m[min(sample, len(self.way_m) - 1)] - self.way_m[0])
        return self.trial.cut_length_before_m + way_m


def parted_at_breakage(dataset: Dataset) -> Dataset:
    """The data set with the trial in two within which a tooth breaks; as it is where none does, where the
    tool has no teeth to tell apart and where the lengths cut are not known."""
    teeth, cuts = dataset.tool.teeth, [each for each in dataset.trials if each.kind == "cut"]
    ordered = len({each.cut_length_before_m for each in cuts}) > 1
    if dataset.tool.kind in LEVEL_KINDS or teeth < 2 or not ordered:
        return dataset
    turned = [_turned(trial, teeth, dataset.sensor.anti_alias) for trial in cuts]
    blocks = [(each, block) for each in turned for block in each.blocks()]
    between = broken_between(
        np.array([each.apart(block) for each, block in blocks]),
        np.array([each.length_m(block.start) for each, block in blocks]),
        np.array([each.length_m(block.stop) for each, block in blocks]),
    )
    broken = None if between is None else next((each for each in turned if _within(each, *between)), None)
    if between is None or broken is None:
        return dataset
    parts, short = _parts(broken, between[1])
    at = dataset.trials.index(broken.trial)
    trials = (*dataset.trials[:at], *parts, *dataset.trials[at + 1 :])
    return replace(dataset, trials=trials, left_out=(*dataset.left_out, *short))


def _turned(trial: Trial, teeth: int, alias: AntiAlias | None) -> _Turned:
    speed, sampled = spindle_speed(trial, teeth, alias), rate_hz(trial)
    highest = max(int(np.minimum(_HARMONICS * teeth, _UNFOLDED * sampled / speed)), 1)
    passing = teeth * np.arange(1, _HARMONICS + 1)
    order = np.union1d(np.arange(1, highest + 1), passing)
    seen = np.abs(passing - sampled / speed * np.round(passing * speed / sampled))
    clear = np.all(np.abs(np.subtract.outer(order, seen)) > _BESIDE, axis=1)
    return _Turned(
        trial,
        spindle_angle(trial, speed),
        along_path(trial),
        order,
        clear & (order <= highest) & (order % teeth != 0),
    )


def _within(turned: _Turned, low_m: float, high_m: float) -> bool:
    """Whether the lengths between which a tooth broke are of this trial."""
    return turned.length_m(0) < low_m and high_m < turned.length_m(len(turned.way_m) - 1)


def _parts(broken: _Turned, begins_m: float) -> tuple[list[Trial], list[LeftOut]]:
    """The trial before and after the tooth broke, and what of it has too few turns; `begins_m` is the length
    cut at the first block in which it is broken."""
    breaks = _sample(broken, begins_m)
    turn = int(np.ceil(2.0 * np.pi / np.mean(np.diff(broken.angle_rad))))
    when = f"{broken.trial.time_s[breaks] - broken.trial.time_s[0]:.4g} s"
    found, short = [], []
    for name, first, last in (("to", 0, breaks - turn), ("from", breaks + turn, len(broken.way_m))):
        file, turns = f"{broken.trial.file}, {name} {when}", (last - first) / turn
        if turns >= _FEWEST_TURNS:
            piece = part_of(broken.trial, broken.way_m, slice(first, last))
            found.append(replace(piece, file=file))
        else:
            why = (
                f"a tooth breaks at {when}: got {max(turns, 0.0):.1f} turns on this side of it, expected "
                f"{_FEWEST_TURNS} or more; longer trials keep both sides."
            )
            short.append(LeftOut(file, why))
    return found, short


def _sample(broken: _Turned, begins_m: float) -> int:
    """At which sample the waves of before and after change over."""
    blocks = broken.blocks()
    first = int(np.argmin([abs(broken.length_m(block.start) - begins_m) for block in blocks]))
    before, after = blocks[: max(first - 1, 1)], blocks[min(first + 1, len(blocks) - 1) :]
    here = slice(blocks[max(first - 1, 0)].start, blocks[first].stop)
    columns, force = broken.columns(here), broken.trial.force_n[here]
    left = [
        np.sum((force - columns @ broken.lines(slice(side[0].start, side[-1].stop))) ** 2, axis=1)
        for side in (before, after)
    ]
    return here.start + int(np.argmin(np.cumsum(left[0] - left[1])))
