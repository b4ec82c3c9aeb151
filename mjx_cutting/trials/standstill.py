"""Whether a channel of force stood still while the others went on: a cable that came off, a logger that hung.

The idea: such a channel holds one value exactly, far longer than it ever repeats a value otherwise, and over
that time another channel moves as much as it does in the rest of the record. A tool that leaves the sheet
brings all channels to rest together, and one whose quanta are coarse repeats itself everywhere.

The assumption that breaks it: something to go on. Where every channel hangs at once, nothing is found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjx_cutting.trials.dataset import Array

LONG_RUN = 50
"""Identical samples that no noisy channel has in a row."""

TIMES_OTHERS = 10
"""The run is this many times as long as the next one of the channel: quanta coarser than the noise give
many runs of like lengths.
"""

AS_IN_THE_REST = 0.5
"""Share of another channel's standard deviation outside the run that it keeps within it."""


@dataclass(frozen=True)
class Standstill:
    """Where a channel stood still: `first` sample, number of `samples`, `value`."""

    first: int
    samples: int
    value: float


def find_standstill(signal: Array, others: Sequence[Array]) -> Standstill | None:
    """Where a `signal` [T] stood still while one of the `others` [T] moved, or None.

    A channel that holds one value throughout is none: a simulated axis may.
    """
    edges = np.flatnonzero(np.diff(signal)) + 1
    starts = np.concatenate([[0], edges])
    lengths = np.diff(np.concatenate([starts, [len(signal)]]))
    if len(lengths) < 2:
        return None
    longest = int(np.argmax(lengths))
    first, samples = int(starts[longest]), int(lengths[longest])
    if samples < max(LONG_RUN, TIMES_OTHERS * int(np.delete(lengths, longest).max())):
        return None
    if not any(_moves_on(other, slice(first, first + samples)) for other in others):
        return None
    return Standstill(first, samples, float(signal[first]))


def _moves_on(other: Array, held: slice) -> bool:
    outside = np.delete(other, held)
    return bool(np.ptp(outside) > 0.0 and np.std(other[held]) > AS_IN_THE_REST * np.std(outside))
