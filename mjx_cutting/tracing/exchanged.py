"""Two trials unlike the others, each of which may be the record of the other's conditions.

Files that change places in the list of a session leave two records under conditions that were not theirs. No
fit without one of them settles anything, since the other still spoils it. So where two trials hold most of
what a model leaves, that found or one with an effect that was tried, and each clearly more of its own force
than the others, they are traced with their conditions exchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.spoiled import beyond_noise
from mjx_cutting.trials.dataset import Dataset, Trial

_FEWEST = 5
_MOST_OF_IT = 0.7
_TIMES_THE_OTHERS = 1.5
_CUT_AS = ("milling", "spindle_speed_rev_s", "feed_speed_m_s", "radial_depth_m", "axial_width_m")
_CONDITIONS = (*_CUT_AS, "material", "tool_id", "cut_length_before_m", "clock_start_s")


class Exchange(NamedTuple):
    """Two trials, by file, of which the conditions change places."""

    first: str
    second: str

    def __str__(self) -> str:
        return (
            f"{self.first} and {self.second}: each was taken for the record of the other's conditions, under "
            "which both are explained far better; check whether their files changed places"
        )


def two_unlike(
    dataset: Dataset, traced: Dataset, left: Sequence[HeldOut], floor_nrmse: float
) -> Exchange | None:
    """The two cut trials that hold most of what is left beyond noise, cut otherwise than each other; None
    where there are none.

    Arguments:
        dataset: the trials as they were given; `traced` as they were traced, one that broke in parts.
        left: error on held-out cut trials of `traced`, in their order, of the models to look at, one after
            another.
        floor_nrmse: share of the force that noise is.
    """
    cuts, given = [trial for trial in traced.trials if trial.kind == "cut"], {t.file for t in dataset.trials}
    for each in left:
        pair = _beside(cuts, each, floor_nrmse)
        if pair is not None and given.issuperset(pair):
            return pair
    return None


def _beside(cuts: Sequence[Trial], left: HeldOut, floor_nrmse: float) -> Exchange | None:
    """The two trials beside one model."""
    error, share = beyond_noise(left, floor_nrmse)
    if not _FEWEST <= len(error) == len(cuts):
        return None
    *others, second, first = np.argsort(error)
    if error[first] + error[second] < _MOST_OF_IT * error.sum():
        return None
    if min(share[first], share[second]) < _TIMES_THE_OTHERS * share[others].max(initial=0.0):
        return None
    one, other = (cuts[index] for index in sorted((int(first), int(second))))
    return Exchange(one.file, other.file) if _of(one, _CUT_AS) != _of(other, _CUT_AS) else None


def exchanged(dataset: Dataset, pair: Exchange) -> Dataset:
    """The trials with the conditions of two exchanged; each file keeps its record."""
    by_file = {trial.file: trial for trial in dataset.trials}
    of_other = {pair.first: by_file[pair.second], pair.second: by_file[pair.first]}
    trials = (
        replace(trial, **_of(of_other[trial.file], _CONDITIONS)) if trial.file in of_other else trial
        for trial in dataset.trials
    )
    return replace(dataset, trials=tuple(trials))


def _of(trial: Trial, names: Sequence[str]) -> dict[str, Any]:
    return {name: getattr(trial, name) for name in names}
