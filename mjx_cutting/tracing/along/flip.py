"""Flip chatter of a tool with an even number of teeth: a line at half of tooth passing in some of the cuts.

At a flip lobe every second tooth cuts deep, so that the force repeats after two teeth (Insperger and others,
Int. J. Machine Tools and Manufacture 43 (2003) 25-40). Of a tool with an even number of teeth the lines of
that, at (k + 1/2) f_t, are orders of the spindle, where teeth that alternate would leave lines as well. Those
are there in every cut, in proportion to the force or flat in feed. Flip chatter has a threshold: it is large
in some cuts and gone in others, at the same speed among them, with the other orders of the spindle, which any
tooth unlike its neighbours would fill, next to empty. With two teeth every such line is one of two teeth that
are alike no more, so a cut after one that shakes must be quiet again; so must it be where one cut alone
shakes, and that one much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.records.comb import SPREAD
from mjx_cutting.tracing.records.lines import basis, order_of_columns
from mjx_cutting.trials.dataset import Dataset

_LEAST_SHARE = 0.03
_LARGE_ALONE = 0.1
_QUIET = 0.1
_OTHER_ORDERS = 0.1
_FEWEST = 2
_STRETCHES = 16
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Flip:
    """The lines at (k + 1/2) f_t of one trial.

    Fields:
        file: name of the trial.
        frequency_hz: half of tooth passing.
        share: RMS of the lines over that of the force.
        size_n: their RMS, N.
        wave_n: [T, 3] the lines, fitted to the whole record.
        error_change_n2: [3] change of the squared error on every other stretch, the lines fitted to the rest.
        alone: whether the spindle's other orders hold next to nothing beside them.
    """

    file: str
    frequency_hz: float
    share: float
    size_n: float
    wave_n: Array
    error_change_n2: Array
    alone: bool

    @property
    def shakes(self) -> bool:
        """Whether a trial by itself looks as if it was at a flip lobe."""
        return bool(self.share >= _LEAST_SHARE and self.alone and self.error_change_n2.sum() < 0.0)


def flipping(dataset: Dataset, after: Sequence[Prediction], orders: int) -> dict[int, Flip]:
    """The trials at a flip lobe by their index in `after`; none where the teeth may do the same, or where
    one alone shakes a little.

    Arguments:
        after: predictions of the model with everything else in it.
        orders: highest order of the spindle that is in the records.
    """
    teeth = dataset.tool.teeth
    if teeth % 2 or teeth // 2 > orders:
        return {}
    each = [_flip(trial, teeth, orders) for trial in after]
    shaking = [i for i, one in enumerate(each) if one.shakes]
    only_one = len(shaking) < _FEWEST
    if not shaking or (only_one and each[shaking[0]].share < _LARGE_ALONE):
        return {}
    share = min(each[i].share for i in shaking)
    size_n = min(each[i].size_n for i in shaking)
    quiet = [i for i, one in enumerate(each) if one.share < _QUIET * share and one.size_n < _QUIET * size_n]
    speeds = np.array([trial.speed_rev_s for trial in after])
    beside = [i for i in shaking if np.any(np.abs(speeds[quiet] / speeds[i] - 1.0) < 2.0 * SPREAD)]
    if not beside or ((only_one or teeth == 2) and not _quiet_again(dataset, after, shaking, quiet)):
        return {}
    return {i: each[i] for i in shaking}


def _flip(trial: Prediction, teeth: int, orders: int) -> Flip:
    columns, order = basis(trial.angle_rad, orders), order_of_columns(orders)
    halves, others = order % teeth == teeth // 2, (order % teeth != 0) & (order % teeth != teeth // 2)
    rest = trial.residual_n
    normal = columns.T @ columns
    weights = np.linalg.lstsq(normal, columns.T @ rest, rcond=None)[0]
    wave, other = columns[:, halves] @ weights[halves], columns[:, others] @ weights[others]
    force = np.sum((trial.measured_n - trial.bias_n) ** 2)
    stretch = np.floor(np.linspace(0.0, _STRETCHES, len(rest), endpoint=False)).astype(int) % 2
    lines, change = columns[:, halves], np.zeros(3)
    for kept in (0, 1):
        own, held = stretch == kept, stretch != kept
        fitted = np.linalg.lstsq(lines[own], rest[own], rcond=None)[0]
        change += np.sum((rest[held] - lines[held] @ fitted) ** 2 - rest[held] ** 2, axis=0)
    return Flip(
        trial.file,
        0.5 * teeth * trial.speed_rev_s,
        float(np.sqrt(np.sum(wave**2) / force)),
        float(np.sqrt(np.mean(np.sum(wave**2, axis=1)))),
        wave,
        change,
        bool(np.sum(other**2) < _OTHER_ORDERS * np.sum(wave**2)),
    )


def _quiet_again(
    dataset: Dataset, after: Sequence[Prediction], shaking: Sequence[int], quiet: Sequence[int]
) -> bool:
    """Whether a tool cuts quietly after it shook, as one that lost a part of a tooth does not; the trials in
    the order of their clock, else as they are listed."""
    trials = {trial.file: trial for trial in dataset.trials}
    cuts = [trials[each.file] for each in after]
    clock = [trial.clock_start_s for trial in cuts]
    when = clock if len(set(clock)) > 1 else list(range(len(cuts)))
    return any(cuts[i].tool_id == cuts[j].tool_id and when[i] < when[j] for i in shaking for j in quiet)
