"""Less of the records: a part of a trial as a trial of its own; the trials less a force."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.records.course import path_axis
from mjx_cutting.trials.dataset import Dataset, Trial


def part_of(trial: Trial, place: NDArray[np.floating], part: slice) -> Trial:
    """The trial over some of its samples only, where on the path, how far cut and when as it was; `place` [T]
    is its way along the path, m."""
    records: dict[str, Any] = {
        name: None if getattr(trial, name) is None else getattr(trial, name)[part]
        for name in (
            "time_s", "force_n", "torque_nm", "position_m", "spindle_angle_rad",
            "spindle_speed_measured_rev_s", "feed_speed_measured_m_s",
        )
    }  # fmt: skip
    if path_axis(trial) is None:
        records["position_m"] = _with_path(trial, place)[part]
    # what is driven back cuts nothing
    way = max(float(place[part.start] - place[0]), 0.0)
    return replace(
        trial,
        cut_length_before_m=trial.cut_length_before_m + way,
        clock_start_s=trial.clock_start_s + float(trial.time_s[part.start] - trial.time_s[0]),
        **records,
    )


def _with_path(trial: Trial, place: NDArray[np.floating]) -> NDArray[np.floating]:
    """[T, 3] what was measured of a trial's position, with its way in an axis of which nothing was."""
    position = np.zeros((trial.samples, 3)) if trial.position_m is None else trial.position_m.copy()
    position[:, np.argmin(np.ptp(position, axis=0))] = place
    return position


def without_force(dataset: Dataset, force_n: Iterable[NDArray[np.floating]]) -> Dataset:
    """The data set less [T, 3] a force in each cut trial."""
    rest, trials = iter(force_n), []
    for trial in dataset.trials:
        trials.append(replace(trial, force_n=trial.force_n - next(rest)) if trial.kind == "cut" else trial)
    return replace(dataset, trials=tuple(trials))
