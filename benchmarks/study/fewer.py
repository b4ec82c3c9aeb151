"""Sessions cut down to what a busy person records: less to tell effects apart by, and no name by mistake.

`one_speed`: the cuts at the commonest nominal speed. `five`: five cuts, spread over the session.
`unstated`: no air cut, no noise figure, no cut length, no clock. Air cuts otherwise stay.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mjx_cutting.trials.dataset import Dataset, Trial


def _one_speed(dataset: Dataset) -> Dataset:
    cuts = [trial for trial in dataset.trials if trial.kind == "cut"]
    speed = Counter(trial.spindle_speed_rev_s for trial in cuts).most_common(1)[0][0]
    return _only(dataset, [trial for trial in cuts if trial.spindle_speed_rev_s == speed])


def _five(dataset: Dataset) -> Dataset:
    cuts = [trial for trial in dataset.trials if trial.kind == "cut"]
    spread = np.unique(np.linspace(0, len(cuts) - 1, 5).round().astype(int))
    return _only(dataset, [cuts[index] for index in spread])


def _unstated(dataset: Dataset) -> Dataset:
    cuts = tuple(
        replace(trial, cut_length_before_m=0.0, clock_start_s=0.0)
        for trial in dataset.trials
        if trial.kind == "cut"
    )
    return replace(dataset, trials=cuts, sensor=replace(dataset.sensor, noise_std_n=None))


def _only(dataset: Dataset, cuts: list[Trial]) -> Dataset:
    air = [trial for trial in dataset.trials if trial.kind == "air"]
    return replace(dataset, trials=(*cuts, *air))


FEWER: dict[str, Callable[[Dataset], Dataset]] = {
    "all": lambda dataset: dataset, "one_speed": _one_speed, "five": _five, "unstated": _unstated,
}  # fmt: skip
"""What is left of a session, by the word for it."""
