"""What cuts in air say of a sensor that was zeroed once for all trials: where its zero was when."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mjx_cutting.trials.dataset import Array, Trial


def less_the_air(trials: Sequence[Trial]) -> list[Trial]:
    """The trials less what cuts in air, if any, read at their time of the clock: a zero may have drifted."""
    airs = sorted((each for each in trials if each.kind == "air"), key=lambda each: each.clock_start_s)
    if not airs:
        return list(trials)
    clock = [each.clock_start_s for each in airs]
    read = np.stack([each.force_n.mean(axis=0) for each in airs])

    def zero(trial: Trial) -> Array:
        return np.array([np.interp(trial.clock_start_s, clock, each) for each in read.T])

    return [replace(trial, force_n=trial.force_n - zero(trial)) for trial in trials]
