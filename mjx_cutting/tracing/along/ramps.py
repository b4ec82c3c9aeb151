"""Entry and exit where most records end before the tool is fully in the sheet: fitted on pieces of the path.

A rim that meets the sheet takes sqrt(2 R a - a^2) until its arc is full: longer than many a record. There is
no steady cut to begin with, then, and a model of the whole arc, fitted to such records, is wrong throughout.
On pieces of the path the end of the sheet is an effect like any other, its response a mean over the stretch.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from jax import Array

from mjx_cutting.cutting import Tool
from mjx_cutting.cutting.effects.entry_exit import EntryExit
from mjx_cutting.tracing.along.ends import NO_END_M, NO_START_M, way_in_m
from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.trials.dataset import Dataset

_UNIT_M = 5e-3
_PLACES = 16
_REACH = 0.3


class EndInPieces(EntryExit):
    """One end of the sheet: its place and the share of the geometry are what is fitted."""

    steady = True
    by_position = True
    places_m: ClassVar[tuple[float, ...]]
    far: ClassVar[bool]

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> EntryExit:
        share, place_m = coordinates[0], _UNIT_M * coordinates[1]
        return cls(share, NO_START_M, place_m - NO_START_M) if cls.far else cls(share, place_m, NO_END_M)

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[1.0, place / _UNIT_M] for place in cls.places_m])


def ends_in_pieces(dataset: Dataset) -> list[type[EndInPieces]]:
    """The near and the far end of the sheet, looked for from where the tool first touches to a third of all
    the path."""
    cuts = [trial for trial in dataset.trials if trial.kind == "cut"]
    paths = [along_path(trial) for trial in cuts]
    low, high = min(float(path.min()) for path in paths), max(float(path.max()) for path in paths)
    reach = float(way_in_m([trial.radial_depth_m for trial in cuts], dataset.tool.diameter_m).max())
    inner = _REACH * (high - low)
    sides = {False: (low - reach, low + inner), True: (high - inner - reach, high)}
    return [
        type("EndInPieces", (EndInPieces,), {"far": far, "places_m": tuple(np.linspace(*side, _PLACES))})
        for far, side in sides.items()
    ]
