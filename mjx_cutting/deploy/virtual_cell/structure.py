"""A mode of the robot's structure: the saw swings on a spring between the arm's tip and itself.

    m x'' + 2 zeta w m x' + m w^2 x = F      along feed and normal, each with its own w

advanced exactly for a force that is constant over the step (matrix exponential). A wrist sensor sees
F - m_s x''. Without a frequency the saw is rigid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from mjx_cutting.deploy.virtual_cell.hidden import RobotMode

Array = NDArray[np.float64]


class Structure:
    """Fields: `shift_m`, `speed_m_s` [2] of the saw against the tip, feed and into the sheet;
    `inertia_n` [2], what the sensor misses of the load."""

    def __init__(self, mode: RobotMode, step_s: float = 1e-3):
        self._mass, self._sensed = mode.mass_kg, mode.sensed_kg
        self._natural = 2.0 * np.pi * np.asarray(mode.frequency_hz)
        self._damping = 2.0 * mode.damping * self._natural
        self._maps = []
        for w, c in zip(self._natural, self._damping, strict=True):
            flow = np.array([[0.0, 1.0, 0.0], [-(w**2), -c, 1.0 / self._mass], [0.0, 0.0, 0.0]])
            self._maps.append(expm(flow * step_s)[:2] if w > 0.0 else np.zeros((2, 3)))
        self.reset()

    def reset(self) -> None:
        """At rest."""
        self.shift_m, self.speed_m_s, self.inertia_n = np.zeros(2), np.zeros(2), np.zeros(2)

    def step(self, force_n: Array) -> None:
        """One step under a force [2], feed and into the sheet."""
        for axis, step in enumerate(self._maps):
            if self._natural[axis] > 0.0:
                x, v, f = self.shift_m[axis], self.speed_m_s[axis], force_n[axis]
                pull = f / self._mass - self._damping[axis] * v - self._natural[axis] ** 2 * x
                self.inertia_n[axis] = self._sensed * pull
                self.shift_m[axis], self.speed_m_s[axis] = step @ (x, v, f)
