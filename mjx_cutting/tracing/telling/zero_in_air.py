"""Does the sensor's zero, which is read in air, stay where the model has it?

A session that was zeroed once and holds several cuts in air shows its zero by itself, whatever the cuts say.
Where that differs between records by more than the model found has it move, the zero moves, though no effect
that moves it could be named.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from mjx_cutting.cutting import ForceModel
from mjx_cutting.tracing.records.air import air_levels
from mjx_cutting.tracing.records.levels import axes_of
from mjx_cutting.trials.dataset import Dataset

_MOVED = 0.01


@dataclass(frozen=True)
class MovedZero:
    """A zero that moves: by how much (N, or N m of a torque) between two records, on which axis, as a share
    of the force there, between which clocks (s)."""

    moved: float
    unit: str
    axis: str
    share: float
    clocks_s: tuple[float, float]

    def __str__(self) -> str:
        low, high = self.clocks_s
        return (
            f"in air the sensor reads {self.moved:.3g} {self.unit} more on {self.axis} ({self.share:.1%} of "
            f"the force) at {high:.0f} s of the clock than at {low:.0f} s, which the model does not have: "
            "its zero drifts, or something moved it"
        )


def zero_in_air(dataset: Dataset, model: ForceModel) -> MovedZero | None:
    """The largest difference between two levels in air that `model` leaves, as a share of the force; None
    below 1 % of it, or where there are no two such levels."""
    air = air_levels(dataset)
    if air is None or len(air.samples) < 2:
        return None
    sensed = jax.vmap(lambda cut: model.sense(jnp.zeros(3), cut))(air.cut)
    left = np.asarray(air.level_n - sensed)
    cuts = np.concatenate([trial.force_n for trial in dataset.trials if trial.kind == "cut"])
    size = np.sqrt(np.mean(cuts**2, axis=0))
    drill = dataset.tool.kind == "drill"
    size = size if drill else np.full(3, float(np.linalg.norm(size)))
    share = np.divide(np.ptp(left, axis=0), size, out=np.zeros(3), where=size > 0.0)
    axis = int(np.argmax(share))
    low, high = int(np.argmin(left[:, axis])), int(np.argmax(left[:, axis]))
    if share[axis] < _MOVED:
        return None
    clock = np.asarray(air.cut.clock_s)
    name = axes_of(dataset.tool.kind)[axis]
    unit = "N m" if drill and name == "torque" else "N"
    moved = float(left[high, axis] - left[low, axis])
    return MovedZero(moved, unit, name, float(share[axis]), (float(clock[low]), float(clock[high])))
