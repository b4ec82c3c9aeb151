"""Entry and exit where most records end before the tool is fully in the sheet: fitted on pieces of the path.

A rim that meets the sheet takes sqrt(2 R a - a^2) until its arc is full: longer than many a record. There is
no steady cut to begin with, then, and a model of the whole arc, fitted to such records, is wrong throughout.
On pieces of the path the end of the sheet is an effect like any other, its response a mean over the stretch.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from jax import Array
from scipy.ndimage import uniform_filter1d

from mjx_cutting.cutting import Tool
from mjx_cutting.cutting.effects.entry_exit import EntryExit
from mjx_cutting.tracing.along.ends import NO_END_M, NO_START_M, met_by, way_in_m
from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.tracing.records.zero import samples_a_turn
from mjx_cutting.trials.dataset import Dataset

_UNIT_M = 5e-3
_PLACES = 16
_REACH = 0.3
_CHANGES = 0.1


class MovingEnds(EntryExit):
    """Ends of the sheet as a response that changes along the path, which lines that move along it hold."""

    steady = True
    by_position = True


class EndInPieces(MovingEnds):
    """One end of the sheet: its place and the share of the geometry are what is fitted."""

    places_m: ClassVar[tuple[float, ...]]
    far: ClassVar[bool]
    met_by: ClassVar[float]

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> EntryExit:
        share, place_m = coordinates[0], _UNIT_M * coordinates[1]
        start_m, length_m = (NO_START_M, place_m - NO_START_M) if cls.far else (place_m, NO_END_M)
        return cls(share, start_m, length_m, cls.met_by)

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[1.0, place / _UNIT_M] for place in cls.places_m])


def ends_in_pieces(dataset: Dataset) -> list[type[EndInPieces]]:
    """The near and the far end of the sheet, met by the rim or by the axis, looked for from where the tool
    first touches to a third of all the path."""
    cuts = [trial for trial in dataset.trials if trial.kind == "cut"]
    paths = [along_path(trial) for trial in cuts]
    low, high = min(float(path.min()) for path in paths), max(float(path.max()) for path in paths)
    reach = way_in_m([trial.radial_depth_m for trial in cuts], dataset.tool.diameter_m)
    longest, inner = float(reach.max()), _REACH * (high - low)
    kinds = []
    for by_axis in met_by(reach):
        late = by_axis * longest
        sides = {
            False: (low - longest + late, low + inner + late),
            True: (high - inner - longest, high + late),
        }
        for far, side in sides.items():
            places = tuple(np.linspace(*side, _PLACES))
            own = {"far": far, "places_m": places, "met_by": by_axis}
            kinds.append(type("EndInPieces", (EndInPieces,), own))
    return kinds


def changes_at_an_end(dataset: Dataset) -> bool:
    """Whether any cut begins or ends with another force, over a turn, than it has most of the time."""
    for trial in dataset.trials:
        if trial.kind == "cut":
            turn = samples_a_turn(trial)
            size = np.sqrt(uniform_filter1d(np.sum(trial.force_n**2, axis=1), turn))
            level, first, last = np.median(size), size[turn // 2], size[-1 - turn // 2]
            if max(abs(first - level), abs(last - level)) > _CHANGES * level:
                return True
    return False
