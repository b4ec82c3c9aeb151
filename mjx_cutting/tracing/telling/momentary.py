"""Is what is left the cutting force itself, larger and smaller from one turn to the next?

Then one factor a turn, on all axes alike, takes as much of it away as a level of its own on every axis does,
though it is free in one number and not in three: what is added beside the cut does not follow the force. A
factor ties the axes together and moves slowly, as crosstalk and drift do, and is neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.fitting.prediction import Prediction, energy
from mjx_cutting.tracing.records.blocks import block_edges, block_means

_FEWEST = 8
_BLOCKS = 400
_MUCH = 0.25
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Momentary:
    """A factor on all of the force that changes from turn to turn.

    Fields: `free` unknowns it has; `share` of the energy left that it is, beyond what noise gives it;
    `without` it, the predictions.
    """

    free: int
    share: float
    without: tuple[Prediction, ...]


def momentary(predictions: Sequence[Prediction], band: float) -> Momentary | None:
    """The factor, where it takes away a quarter of what is left or more, and not less than levels do.

    Arguments: predictions of every trial; `band`, independent samples per sample.
    """
    left = [each.residual_n - each.residual_n.mean(axis=0) for each in predictions]
    whole = energy(left)
    without, by_level, free = [], 0.0, 0
    for each, rest in zip(predictions, left, strict=True):
        edges = _turns(each)
        length = np.diff(edges, append=len(rest))
        force = each.predicted_n - each.bias_n
        product, square = (
            np.add.reduceat(np.sum(a * b, axis=1), edges) for a, b in ((rest, force), (force, force))
        )
        factor = np.repeat(product / np.maximum(square, 1e-300), length)
        factor -= factor.mean()
        without.append(replace(each, predicted_n=each.predicted_n + factor[:, None] * force))
        by_level += sum(float(np.sum(block_means(axis, edges) ** 2 * length)) for axis in rest.T)
        free += len(edges)
    after = energy([each.residual_n - each.residual_n.mean(axis=0) for each in without])
    samples = 3.0 * band * sum(len(each) for each in left)
    noise = after / max(samples - free, 1.0)
    taken, by_level = whole - after - free * noise, by_level - 3.0 * free * noise
    if taken < max(_MUCH * whole, by_level):
        return None
    return Momentary(free, taken / max(whole, 1e-300), tuple(without))


def _turns(each: Prediction) -> NDArray[np.int64]:
    """Where the turns of the spindle begin in a record, or stretches of at least eight samples."""
    turns = int(np.ptp(each.angle_rad) / (2.0 * np.pi))
    return block_edges(len(each.time_s), max(min(turns, len(each.time_s) // _FEWEST, _BLOCKS), 1))
