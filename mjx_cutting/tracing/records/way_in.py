"""How far a drill or a turning tool is fed before it is fully in, where one record does not tell.

It comes in over its point or its lead angle, which is as long in every trial. At a low feed the ramp may fill
nearly all of a record, which then shows no bend into a level (`steady`). But where others do, they tell how
far beyond half the force that bend is, along the path: there the level of such a record begins. Where the
sheet is uneven, and too few bend into an even level, bends into one that swings tell it, if they agree.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.tracing.records.steady import bend_in, steady
from mjx_cutting.trials.dataset import Trial

_TOP = 98.0
_HALF = 0.5
_ALIKE = 0.25
_BEYOND = 1.05
_FEWEST_BENDS = 3
_FEWEST_SAMPLES = 8
Array = NDArray[np.floating]


def levels_of(trials: Sequence[Trial]) -> dict[str, slice | None]:
    """By file, the samples at which each cut is in full engagement; None where its record ends before."""
    cuts = [trial for trial in trials if trial.kind == "cut"]
    found: dict[str, slice | None] = {trial.file: steady(trial.force_n) for trial in cuts}
    ways = {trial.file: along_path(trial) - along_path(trial)[_half(trial)] for trial in cuts}
    bends = {trial.file: bend_in(trial.force_n) for trial in cuts}
    usual = _usual(bends, ways)
    if usual is None:
        usual = _usual({trial.file: bend_in(trial.force_n, wavy=True) for trial in cuts}, ways)
    if usual is None:
        return found
    for trial in cuts:
        level = found[trial.file]
        if bends[trial.file] is None and level is not None:
            begin = max(level.start or 0, int(np.argmax(ways[trial.file] > _BEYOND * usual)))
            stop = len(trial.time_s) if level.stop is None else level.stop
            inside = ways[trial.file][-1] > _BEYOND * usual and stop - begin >= _FEWEST_SAMPLES
            found[trial.file] = slice(begin, stop) if inside else None
    return found


def _usual(bends: Mapping[str, int | None], ways: Mapping[str, Array]) -> float | None:
    """How far beyond half the force records bend, m; None where few do, or not alike."""
    far_m = np.array([ways[file][at] for file, at in bends.items() if at is not None])
    if len(far_m) < max(_FEWEST_BENDS, len(bends) - len(far_m)):
        return None
    usual = float(np.median(far_m))
    return None if usual <= 0.0 or np.median(np.abs(far_m - usual)) > _ALIKE * usual else usual


def _half(trial: Trial) -> int:
    """The first sample of a cut at half of the most force that it shows for long."""
    force: NDArray[np.floating] = np.abs(trial.force_n)
    size = np.linalg.norm(force / np.maximum(np.percentile(force, _TOP, axis=0), 1e-12), axis=1)
    return int(np.argmax(size > _HALF * np.percentile(size, _TOP)))
