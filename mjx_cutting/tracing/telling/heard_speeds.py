"""Of which trials the spindle's speed within the record was not measured, but heard in the force."""

from __future__ import annotations

import numpy as np

from mjx_cutting.tracing.records.even_time import even_time
from mjx_cutting.tracing.telling.few import first_few
from mjx_cutting.trials.dataset import Dataset


def heard_speeds(records: Dataset, traced: Dataset) -> str | None:
    """In words, in which trials and by how much; None where in none.

    Arguments: the trials before anything was heard in them, and by the same files as they were traced.
    """
    unseen = {trial.file for trial in records.trials if even_time(trial) is None}
    wanders = {}
    for trial in traced.trials:
        speed = trial.spindle_speed_measured_rev_s
        if trial.file in unseen and speed is not None and even_time(trial) is not None:
            wanders[trial.file] = float(np.max(np.abs(speed / np.mean(speed) - 1.0)))
    if not wanders:
        return None
    told = [f"{file} by {wanders[file]:.2%}" for file in sorted(wanders, key=lambda file: -wanders[file])]
    return (
        f"the spindle's speed wanders within the record ({first_few(told)}): not measured, "
        "but heard in the force, where tooth passing and its harmonics move in phase, the k-th k times as "
        "far as the first; lines are those of the angle that it integrates to"
    )
