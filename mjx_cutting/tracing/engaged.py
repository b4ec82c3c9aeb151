"""Records that begin or end in the air, each at a place of its own: cut down to where the tool is in the cut.

Where the sheet ends at one place for all trials, `sheet` finds that place and holds its ramps against
geometry. A recorder that was started by hand, or sheets clamped anew, show the same ramps at other places in
every trial. Lines of a whole record then mix cut and air, and nothing that is found on them can be believed.
So if the force, over one revolution, is next to none at the beginning or the end of records, those are cut
down to where it has reached its level and the arc, by geometry, has become full.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from mjx_cutting.tracing.course import along_path
from mjx_cutting.tracing.part import part_of
from mjx_cutting.trials.dataset import Dataset, ToolInfo, Trial

_AIR = 0.2
_LEVEL = 0.85
_USUAL = 75.0
_CLEAR = 1.1
_FEWEST_TURNS = 3.0
_LEAST_TURNS = 10.0
_FEWEST_IN_AIR = 10


@dataclass(frozen=True, eq=False)
class Engaged:
    """The trials cut down. Fields: `dataset`; `spans_s` first and last time kept of every trial that was cut
    down, by file."""

    dataset: Dataset
    spans_s: dict[str, tuple[float, float]]

    def __str__(self) -> str:
        told = ", ".join(f"{file} {low:.2f} to {high:.2f} s" for file, (low, high) in self.spans_s.items())
        return (
            "the tool enters or leaves the sheet within records, at a place of its own in each; they were "
            f"traced where it is in the cut ({told})"
        )


def engaged(dataset: Dataset) -> Engaged | None:
    """The trials where their tools are in the cut; None where no record begins or ends in the air."""
    cuts = [trial for trial in dataset.trials if trial.kind == "cut"]
    stays = {trial.file: stay for trial in cuts if (stay := _stay(trial, dataset.tool)) is not None}
    if not stays:
        return None
    sensor = dataset.sensor
    shown = all(trial.file in stays and stays[trial.file].air >= _FEWEST_IN_AIR for trial in cuts)
    zeroed = shown and sensor.zeroed == "trial"
    trials = []
    for trial in dataset.trials:
        if zeroed and trial.kind == "air":
            trial = replace(trial, force_n=trial.force_n - trial.force_n.mean(axis=0))
        if trial.file in stays:
            stay = stays[trial.file]
            if zeroed:
                trial = replace(trial, force_n=trial.force_n - trial.force_n[: stay.air].mean(axis=0))
            trial = part_of(trial, along_path(trial), stay.part)
        trials.append(trial)
    spans = {t.file: (float(t.time_s[0]), float(t.time_s[-1])) for t in trials if t.file in stays}
    # a sensor zeroed before every trial is zeroed in the air, where all records show enough of it
    sensor = replace(sensor, zeroed="session") if zeroed else sensor
    return Engaged(replace(dataset, trials=tuple(trials), sensor=sensor), spans)


@dataclass(frozen=True)
class _Stay:
    """Where a tool is in the cut. Fields: `part` samples; `air` samples before the first touch."""

    part: slice
    air: int


def _stay(trial: Trial, tool: ToolInfo) -> _Stay | None:
    """Where the tool is in the cut; None where it is from the first sample to the last, or hardly ever."""
    rate_hz = (len(trial.time_s) - 1) / float(trial.time_s[-1] - trial.time_s[0])
    turn = max(round(rate_hz / trial.spindle_speed_rev_s), 1)
    size = np.sqrt(uniform_filter1d(np.sum(trial.force_n**2, axis=1), turn, mode="nearest"))
    level = float(np.percentile(size, _USUAL))
    touching = np.flatnonzero(size > _AIR * level)
    full = np.flatnonzero(size > _LEVEL * level)
    least = round(_FEWEST_TURNS * turn)
    before, after = int(touching[0]), len(size) - 1 - int(touching[-1])
    if max(before, after) < least:
        return None
    ramp = turn + round(_CLEAR * _reach_m(trial, tool) / trial.feed_speed_m_s * rate_hz)
    first = int(max(full[0] + turn, touching[0] + ramp)) if before >= least else 0
    last = int(min(full[-1] - turn, touching[-1] - ramp)) if after >= least else len(size) - 1
    if last - first < _LEAST_TURNS * turn:
        return None
    return _Stay(slice(first, last + 1), max(before - turn, 0) if before >= least else 0)


def _reach_m(trial: Trial, tool: ToolInfo) -> float:
    """Way from the first touch of the sheet until the arc is full, m."""
    radius, depth = 0.5 * tool.diameter_m, trial.radial_depth_m
    return radius if depth >= radius else float(np.sqrt(depth * (2.0 * radius - depth)))
