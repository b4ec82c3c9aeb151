"""Records of a force model by its lines, of which nothing but its effects repeats once a turn."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.cutting import Cut, ForceModel, order_lines


@pytest.fixture
def by_lines() -> Callable[[ForceModel, Cut, int, np.ndarray, float], np.ndarray]:
    """Call it with a model, a cut, the highest order, times [T], s, and a phase, rad: [T, 3] force, N."""

    def force(model: ForceModel, cut: Cut, orders: int, time_s: np.ndarray, phase_rad: float) -> np.ndarray:
        with _platform.x64():
            lines = np.asarray(order_lines(model, cut, orders, 64 * model.tool.teeth))
        angle = cut.spindle_speed_rev_s * 2.0 * np.pi * time_s + phase_rad
        turns = np.exp(1j * np.outer(angle, np.arange(orders + 1)))
        return 2.0 * np.real(turns @ lines) - np.real(lines[0])

    return force
