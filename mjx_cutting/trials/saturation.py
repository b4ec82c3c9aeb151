"""Whether a force record was cut off at the end of the sensor's range.

The idea: a saturated channel repeats its largest (or smallest) value exactly and arrives there by a jump, or
that value is a spike in the histogram of the record's upper end. Neither happens to a noisy signal, quantised
or not: near a smooth peak a quantised signal steps by one or two of its quanta, and a sine's own histogram
rises at its end by 2.4 at most (arcsine law).

The assumption that breaks it: some noise. A noise-free record that jumps to a flat top looks saturated. A
record that rests at one value near zero (no contact) is not taken for saturated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjx_cutting.trials.dataset import Array

LONG_RUN = 8
SHORT_RUN = 3
SHORT_RUNS = 3
"""One run of 8 identical extreme samples, or three runs of 3, entered or left by a jump, are saturation.
(A single run of 4 occurs in sound measured records of 200 samples.)
"""

JUMP_QUANTA = 3.0
"""A jump is more than this many quanta (the smallest difference between two values of the record).

Around a parabolic peak that rounding flattens to a run of n samples the next sample lies up to
((n+1)/(n-1))^2 quanta lower, so a run has to beat that as well.
"""

LOWEST_LIMIT = 0.5
"""A sensor's range is about symmetric: a limit below half of what the record reaches is a rest level."""

SPIKE_COUNT = 12
SPIKE_RATIO = 5.0
"""The extreme value is a spike when it occurs SPIKE_COUNT times and SPIKE_RATIO times as often as any of the
next ten values, and more than twice as often as any other.
"""


@dataclass(frozen=True)
class Saturation:
    """One clipped end of a channel: the value it stops at, how many samples stand there, the longest run of
    them.
    """

    value: float
    samples: int
    longest_run: int


def find_saturation(signal: Array) -> Saturation | None:
    """The clipped end of a signal [T] (the upper one if both are), or None.

    Only an upper end above zero and a lower end below zero can be the end of a sensor's range, and only if
    the record does not go much further on the other side.
    """
    if len(signal) < LONG_RUN or not np.isfinite(signal).all():
        return None
    for sign in (1.0, -1.0):
        found = _clipped_above(sign * signal)
        if found is not None:
            return Saturation(sign * found.value, found.samples, found.longest_run)
    return None


def _clipped_above(signal: Array) -> Saturation | None:
    top = float(signal.max())
    at_top = signal == top
    count = int(at_top.sum())
    reached = float(np.abs(signal).max())
    if top <= 0.0 or top < LOWEST_LIMIT * reached or count < LONG_RUN or count == len(signal):
        return None
    edges = np.flatnonzero(np.diff(np.concatenate([[False], at_top, [False]]).astype(np.int8)))
    starts, ends = edges[::2], edges[1::2]
    lengths = ends - starts
    # The upper tenth of the range is enough to know the quantum, and far cheaper than the whole record.
    near = signal[signal >= top - 0.1 * (top - float(signal.min()))]
    values, counts = np.unique(near, return_counts=True)
    if len(values) < 2:
        values, counts = np.unique(signal, return_counts=True)
    quantum = float(np.diff(values).min())
    before = np.where(starts > 0, top - signal[np.maximum(starts - 1, 0)], 0.0)
    after = np.where(ends < len(signal), top - signal[np.minimum(ends, len(signal) - 1)], 0.0)
    jump = np.maximum(before, after) / quantum
    parabola = ((lengths + 1) / np.maximum(lengths - 1, 1)) ** 2
    jumped = (jump > JUMP_QUANTA) & ((lengths < SHORT_RUN) | (jump > 2 + 1.5 * parabola))
    longest = int(lengths.max())
    run = (
        bool((jumped & (lengths >= LONG_RUN)).any())
        or int((jumped & (lengths >= SHORT_RUN)).sum()) >= SHORT_RUNS
    )
    spike = count >= SPIKE_COUNT and count > SPIKE_RATIO * int(counts[:-1][-10:].max())
    if not run and spike and bool(jumped.any()):
        # A noise-free record sampled in step with the spindle repeats its other values as well.
        elsewhere = int(np.unique(signal[~at_top], return_counts=True)[1].max())
        spike = count > 2 * elsewhere
    return Saturation(top, count, longest) if run or (spike and bool(jumped.any())) else None
