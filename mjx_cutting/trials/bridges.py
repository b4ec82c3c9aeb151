"""A line between the sound neighbours in place of samples that were not measured, and in words where."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.trials.dataset import Dataset, Trial, columns_to_process

Found = dict[str, NDArray[np.int64]]
"""Samples by column of a trial's file."""


def bridged(
    dataset: Dataset, find: Callable[[Trial], Found], said: Callable[[Found], str]
) -> tuple[Dataset, tuple[str, ...]]:
    """The trials with a line in place of what `find` finds in each, none where nothing; and what was `said`
    of it, trial by trial, with the time of the first."""
    trials, told = [], []
    for trial in dataset.trials:
        found = find(trial)
        if found:
            trial = _bridged(trial, found, dataset.axes)
            first = min(int(each[0]) for each in found.values())
            told.append(f"{trial.file}: {said(found)} (the first at {trial.time_s[first]:.4g} s)")
        trials.append(trial)
    return (replace(dataset, trials=tuple(trials)), tuple(told)) if told else (dataset, ())


def _bridged(trial: Trial, found: Found, axes: Sequence[str] | None) -> Trial:
    mended = []
    for name, values in trial.columns(axes):
        sound = np.delete(np.arange(trial.samples), found.get(name, ()))
        mended.append(np.interp(np.arange(trial.samples), sound, values[sound]))
    if trial.torque_nm is None:
        return replace(trial, force_n=columns_to_process(np.stack(mended, axis=1), axes))
    force_n = trial.force_n.copy()
    force_n[:, 2], torque_nm = mended
    return replace(trial, force_n=force_n, torque_nm=torque_nm)
