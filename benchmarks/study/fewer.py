"""Sessions as a busy person records them: less to tell effects apart by, and no name by mistake.

`one_speed`: the cuts at the commonest nominal speed. `five`: five cuts, spread over the session.
`unstated`: no air cut, no noise figure, no cut length, no clock. Air cuts otherwise stay.
`scattered`: all of them, the force of each cut larger or smaller as a whole, by 1.3 % (standard deviation).
`materials`: all of them, every other cut in a sheet that is named otherwise and asks for .4 of the force.
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


def _scattered(dataset: Dataset) -> Dataset:
    # another draw for every session, the same one each time
    drawn = np.random.default_rng(round(1e6 * abs(float(dataset.trials[0].force_n[0, 2]))))
    cuts = tuple(
        replace(trial, force_n=factor * trial.force_n, torque_nm=_times(factor, trial.torque_nm))
        if trial.kind == "cut"
        else trial
        for trial, factor in zip(
            dataset.trials, 1.0 + _SCATTER * drawn.normal(size=len(dataset.trials)), strict=True
        )
    )
    return replace(dataset, trials=cuts)


def _materials(dataset: Dataset) -> Dataset:
    air = [trial.force_n.mean(axis=0) for trial in dataset.trials if trial.kind == "air"]
    session = dataset.sensor.zeroed == "session" and air
    zero_n = np.mean(air, axis=0) if session else np.zeros(3)
    trials, cuts = [], 0
    for trial in dataset.trials:
        factor, name = (_SOFTER, "softer") if cuts % 2 else (1.0, "harder")
        if trial.kind == "cut":
            cuts += 1
            force_n = zero_n + factor * (trial.force_n - zero_n)
            torque_nm = _times(factor, trial.torque_nm)
            trial = replace(trial, material=name, force_n=force_n, torque_nm=torque_nm)
        trials.append(trial)
    # a bias that no air shows is as much smaller, and no longer that of the session
    sensor = replace(dataset.sensor, zeroed="session" if session else "trial")
    return replace(dataset, trials=tuple(trials), sensor=sensor)


def _times(factor: float, torque_nm: np.ndarray | None) -> np.ndarray | None:
    return None if torque_nm is None else factor * torque_nm


def _only(dataset: Dataset, cuts: list[Trial]) -> Dataset:
    air = [trial for trial in dataset.trials if trial.kind == "air"]
    return replace(dataset, trials=(*cuts, *air))


_SCATTER = 0.013
_SOFTER = 0.4
FEWER: dict[str, Callable[[Dataset], Dataset]] = {
    "all": lambda dataset: dataset, "one_speed": _one_speed, "five": _five, "unstated": _unstated,
    "scattered": _scattered, "materials": _materials,
}  # fmt: skip
"""What is left of a session, by the word for it."""
