"""Drills and turning tools: what is traced is the level of each trial, not its lines.

Such a tool is always engaged, so a turn has no shape to speak of: thrust and torque of a drill, the three
forces of a turning tool, each at the steady part of the trial. A sensor zeroed before the trial reads nothing
there but the cut, so no bias is fitted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.tracing.records.part import part_of
from mjx_cutting.trials.dataset import Dataset, Trial

LEVEL_KINDS = ("drill", "turning")
_IN_CUT = 0.5
_TRIMMED = 0.1
_FEWEST = 8


def axes_of(kind: str) -> tuple[str, str, str]:
    """What the three columns of the force are for a tool of this kind."""
    return ("nothing", "torque", "thrust") if kind == "drill" else ("x", "y", "z")


def as_levels(dataset: Dataset) -> Dataset:
    """The dataset with every trial of a drill or turning tool cut down to its steady part; others unchanged.

    For drills the columns of `force_n` become nothing, torque (N m) and thrust (N), which both count positive
    against the cut, whichever way they were recorded.
    """
    if dataset.tool.kind not in LEVEL_KINDS:
        return dataset
    trials = [_level(trial, dataset.tool.kind) for trial in dataset.trials]
    if dataset.tool.kind == "drill":
        mean = sum((trial.force_n.mean(axis=0) for trial in trials if trial.kind == "cut"), np.zeros(3))
        against = np.where(mean < 0.0, -1.0, 1.0)
        trials = [replace(trial, force_n=against * trial.force_n) for trial in trials]
    return replace(dataset, trials=tuple(trials))


def _level(trial: Trial, kind: str) -> Trial:
    force = trial.force_n
    if kind == "drill":
        torque = np.zeros(len(force)) if trial.torque_nm is None else trial.torque_nm
        force = np.stack([np.zeros(len(force)), torque, force[:, 2]], axis=-1)
    channels = replace(trial, force_n=force, torque_nm=None)
    return part_of(channels, along_path(trial), _steady(force)) if trial.kind == "cut" else channels


def _steady(force: NDArray[np.floating]) -> slice:
    """Samples in full engagement: from the first to the last above half the usual force, ends trimmed."""
    size = np.linalg.norm(force / np.maximum(np.abs(force).max(axis=0), 1e-12), axis=1)
    usual = float(np.median(size[size >= 0.2 * size.max()]))
    inside = np.flatnonzero(size > _IN_CUT * usual)
    if len(inside) < _FEWEST:
        return slice(None)
    first, last = int(inside[0]), int(inside[-1]) + 1
    trim = int(_TRIMMED * (last - first))
    return slice(first + trim, last - trim)
