"""Which part of the records of a drill or a turning tool was traced: where the force is at its level."""

from __future__ import annotations

import numpy as np

from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.surface import PLACES_APART_M
from mjx_cutting.tracing.telling.few import first_few
from mjx_cutting.trials.dataset import Dataset

_SAMPLES = 1.5


def at_level(records: Dataset, traced: Dataset) -> str | None:
    """In words, from when to when each cut of `records` was `traced`; None where that is all of it.

    Arguments: the trials as recorded, and by the same files as cut down to their levels.
    """
    if records.tool.kind not in LEVEL_KINDS:
        return None
    part = {trial.file: (float(trial.time_s[0]), float(trial.time_s[-1])) for trial in traced.trials}
    told = []
    for trial in records.trials:
        if trial.kind != "cut" or trial.file not in part:
            continue
        low, high = part[trial.file]
        begin, end = float(trial.time_s[0]), float(trial.time_s[-1])
        sample = (end - begin) / (len(trial.time_s) - 1)
        if max(low - begin, end - high) > _SAMPLES * sample:
            told.append(f"{trial.file} {low:.2f} to {high:.2f} of {begin:.2f} to {end:.2f} s")
    if not told:
        return None
    counted = "; places count from where each touches the work" if _from_the_touch(records, traced) else ""
    return (
        f"judged was the level of each trial ({first_few(told)}): what the force does while "
        f"the tool comes in or goes out was not traced{counted}"
    )


def _from_the_touch(records: Dataset, traced: Dataset) -> bool:
    """Whether the places of the trials traced are not those along the records."""
    whole = {trial.file: trial for trial in records.trials}
    for trial in traced.trials:
        of = whole.get(trial.file)
        if trial.kind == "cut" and of is not None:
            recorded = np.interp(trial.time_s[0], of.time_s, along_path(of))
            if abs(recorded - along_path(trial)[0]) > PLACES_APART_M:
                return True
    return False
