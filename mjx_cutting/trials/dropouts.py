"""A few samples lost on the way, which a logger fills with zeros or with the last value it had.

The idea: noise never repeats itself, so samples in which every channel repeats the one before exactly were
not measured. What lies between is bridged by a line; the rest of the record is sound.

The assumption that breaks it: a sensor finer than its noise. Where a record repeats itself elsewhere too, for
its quanta are coarse or it has no noise, or where more than a hundredth of it does, nothing is done.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.trials.bridges import Found, bridged
from mjx_cutting.trials.dataset import Dataset, Trial

FEWEST = 3
"""Samples alike in every channel, one after another, that no noise makes."""

MOST_SHARE = 0.01
"""Of more samples than this something else is the matter."""


def find_dropouts(trial: Trial, axes: Sequence[str] | None = None) -> NDArray[np.int64]:
    """Samples [D] of a trial that were lost; `axes` as in `Dataset`."""
    values = np.stack([values for _, values in trial.columns(axes)], axis=1)
    again = np.all(np.diff(values, axis=0) == 0.0, axis=1)
    turns = np.flatnonzero(np.diff(np.concatenate([[False], again, [False]]).astype(int)))
    # samples first to last are alike; nothing was measured in the first either where all are nil
    alike = turns.reshape(-1, 2)
    within = np.all((alike[:, 1] - alike[:, 0] + 1 >= FEWEST) & (alike[:, 0] > 0))
    if not within or np.any(alike[:, 1] >= trial.samples - 1):
        return np.zeros(0, np.int64)
    lost = [np.arange(first + bool(np.any(values[first])), last + 1) for first, last in alike.tolist()]
    found = np.concatenate([np.zeros(0, np.int64), *lost])
    return found if len(found) <= MOST_SHARE * trial.samples else np.zeros(0, np.int64)


def without_dropouts(dataset: Dataset) -> tuple[Dataset, tuple[str, ...]]:
    """The trials with a line between the neighbours in place of lost samples, and in words what was replaced,
    trial by trial."""

    def find(trial: Trial) -> Found:
        lost = find_dropouts(trial, dataset.axes)
        return {name: lost for name, _ in trial.columns(dataset.axes)} if len(lost) else {}

    def said(found: Found) -> str:
        count = len(next(iter(found.values())))
        return (
            f"{count} samples that repeat the one before in every channel were replaced by the line between "
            "their neighbours"
        )

    return bridged(dataset, find, said)
