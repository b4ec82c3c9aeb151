"""A motor that follows the torque within the turn, as part of every model of the lines.

Lines stand where the loaded spindle turned, and that it gives way is told by this (`along.droop`). A motor
with little inertia speeds up and slows down between the teeth as well, which draws the lines out of the shape
that even turning gives them. Its bandwidth and its droop, about the one that the speeds tell, are then fitted
beside the six constants.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting import Tool
from mjx_cutting.cutting.effects.spindle_droop import UnderLoad

_TYPICAL_HZ = 1000.0
AT_ONCE_HZ = 5e5
"""The highest bandwidth that is told from an answer at once."""


class Swinging(UnderLoad):
    """The motor, its droop counted in what the problem knows of it (`Problem.droop_rev_s_nm`)."""

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 2

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> Swinging:
        """Coordinates log droop and the root of the lag: an answer at once is no end of a range."""
        lag = jnp.maximum(coordinates[1] ** 2, _TYPICAL_HZ / AT_ONCE_HZ)
        return cls(jnp.exp(coordinates[0]), _TYPICAL_HZ / lag)

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[0.0, 1.0]])

    def in_unit(self, droop_rev_s_nm: ArrayLike) -> Swinging:
        """The same with its droop counted in that, rev/s/(N m)."""
        return Swinging(self.droop_rev_s_nm * droop_rev_s_nm, self.bandwidth_hz)
