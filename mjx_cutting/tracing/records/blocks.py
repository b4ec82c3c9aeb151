"""A record in blocks of nearly equal length, for sums over what hardly changes within one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


def block_edges(samples: int, most: int) -> NDArray[np.int64]:
    """Where the blocks begin, at most as many as there are samples."""
    return np.linspace(0, samples, min(most, samples), endpoint=False).astype(int)


def block_means(value: Array, edges: NDArray[np.int64]) -> Array:
    """[B] mean of `value` [T] over each block."""
    return np.asarray(np.add.reduceat(value, edges) / np.diff(edges, append=len(value)))
