"""Single samples that stand far from their neighbours: a loose contact, a relay, a bit that fell over.

The idea: how far each sample is from the median of the five about it. What a tooth does in one sample it does
again with the next, so those distances have a scale of their own, and a spike is several times beyond it,
rare, alone, and not there again a turn of the spindle later.

The assumption that breaks it: forces sampled finely enough that a tooth's own is more than two samples long,
or repeats itself from turn to turn.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter

from mjx_cutting.trials.bridges import Found, bridged
from mjx_cutting.trials.dataset import Array, Dataset, Trial

ABOUT = 5
"""Samples of which the median is taken: it passes by one or two that stand out, and keeps an edge."""

EDGE = ABOUT // 2
"""Samples at the ends of a record, which have neighbours on one side only and are not judged."""

FEW = (99.5, 6.0, 4e-3)
MANY = (97.0, 30.0, 2e-2)
"""A spike is as many times (the second) as far from the median as the first per cent of the samples are. Of
a larger share of them than the third, which is less than those per cent leave out, something else is the
matter. Where the few are none or too many, the many are looked for, which stand out further.
"""

STEP_PERCENT = 90.0
"""The many stand out as much against the steps from sample to sample, but the largest, too."""

AGAIN = 0.3
SPEED_ERROR = 0.02
"""What is there again with this share of its size a turn before or later, that being known as well as the
speed, belongs to a tooth.
"""


def find_spikes(signal: Array, turn_samples: float) -> NDArray[np.int64]:
    """Samples of a `signal` [T] that are spikes; `turn_samples` in a turn of the spindle."""
    if len(signal) < 2 * ABOUT:
        return np.zeros(0, np.int64)
    away = np.abs(signal - median_filter(signal, ABOUT, mode="mirror"))
    quantum = float(np.diff(np.unique(signal)).min(initial=np.inf))
    inside = away.copy()
    inside[:EDGE] = inside[-EDGE:] = 0.0
    far = _far(away, inside, quantum, FEW)
    # what the many are apart by is no turn: it is there before and after where it is a tooth's
    beside = any if len(far) else all
    if not len(far):
        # what is smooth hardly strays from its medians: there the steps say what is usual
        step = float(np.percentile(np.abs(np.diff(signal)), STEP_PERCENT))
        far = _far(away, inside, max(quantum, step), MANY)
    away = inside
    reach = max(round(SPEED_ERROR * turn_samples), 2)
    near = maximum_filter1d(away, 2 * reach + 1, mode="constant")
    turn = round(turn_samples)

    def again(spike: int) -> bool:
        other = (spike - turn, spike + turn)
        return beside(near[each] > AGAIN * away[spike] for each in other if 0 <= each < len(away))

    return np.array([each for each in far.tolist() if not again(each)], np.int64)


def _far(away: Array, inside: Array, quantum: float, rule: tuple[float, float, float]) -> NDArray[np.int64]:
    """Samples that a rule finds far from the median, of distances `away` [T], but the ends' `inside`; none
    where they are too many."""
    percent, times, most_share = rule
    far = np.flatnonzero(inside > times * max(float(np.percentile(away, percent)), quantum))
    return far if len(far) <= max(most_share * len(away), 1.0) else np.zeros(0, np.int64)


def trial_spikes(trial: Trial, axes: Sequence[str] | None = None) -> Found:
    """The spikes of a trial by column of its file; `axes` as in `Dataset`."""
    turn = (trial.samples - 1) / trial.revolutions
    found = {name: find_spikes(values, turn) for name, values in trial.columns(axes)}
    return {name: spikes for name, spikes in found.items() if len(spikes)}


def without_spikes(dataset: Dataset) -> tuple[Dataset, tuple[str, ...]]:
    """The trials with a line between the neighbours in place of every spike, and in words what was replaced,
    trial by trial."""

    def said(found: Found) -> str:
        return (
            f"{sum(map(len, found.values()))} samples far from their neighbours were replaced by the line "
            f"between those in {', '.join(found)}"
        )

    return bridged(dataset, lambda trial: trial_spikes(trial, dataset.axes), said)
