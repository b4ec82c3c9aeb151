"""The removed volume, from where the saw has been: the lowest point that its circle reached over each cell.

Independent of the teeth: the sum of their chips (saw.py) must come out the same, and a test says it does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
CELL_M = 2.5e-4
REACH_M = 0.016


class Kerf:
    """Depths of the cut along the path below the sheet's top, m, in cells of a quarter millimetre."""

    def __init__(self, start_m: float, end_m: float, thickness_m: float, radius_m: float):
        self.centre_m = start_m + CELL_M * (np.arange(round((end_m - start_m) / CELL_M)) + 0.5)
        self.depth_m = np.zeros(self.centre_m.size)
        self._start, self._thickness, self._radius = start_m, thickness_m, radius_m

    def cut(self, along_m: float, depth_m: float) -> float:
        """The area, m^2, that a saw takes with its lowest point at `along_m`, `depth_m` below the top."""
        if depth_m <= 0.0:
            return 0.0
        reach = min(REACH_M, (2.0 * self._radius * depth_m) ** 0.5 + CELL_M)
        first = max(int((along_m - reach - self._start) / CELL_M), 0)
        last = max(int((along_m + reach - self._start) / CELL_M) + 1, 0)
        apart = self.centre_m[first:last] - along_m
        profile = depth_m - self._radius + np.sqrt(np.maximum(self._radius**2 - apart * apart, 0.0))
        before = self.depth_m[first:last]
        after = np.maximum(before, np.minimum(profile, self._thickness))
        area = float(np.sum(after - before)) * CELL_M
        self.depth_m[first:last] = after
        return area
