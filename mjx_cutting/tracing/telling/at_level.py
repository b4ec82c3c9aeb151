"""Which part of the records of a drill or a turning tool was traced: where the force is at its level."""

from __future__ import annotations

from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.trials.dataset import Dataset

_SAMPLES = 1.5
_SHOWN = 4


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
    more = f" and {len(told) - _SHOWN} more" if len(told) > _SHOWN else ""
    return (
        f"judged was the level of each trial ({', '.join(told[:_SHOWN])}{more}): what the force does while "
        "the tool comes in or goes out was not traced"
    )
