"""Is what a steady effect explains there all the time, or does it come and go?

A chip that sticks to one tooth for some turns, a loose insert, spikes once a turn: each leaves lines that
runout, pitch or a broken tooth imitate in the mean. But those are there in every turn. So each record is cut
in blocks of several turns, and how much of the effect is in each is asked; where that differs from block to
block about as much as it is large, beyond what noise does, the cause is none that is steady. A wave beside
it, of no line of the spindle, lends blocks a little of itself; so what comes and goes must be more than a
small part of all else that is left.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.fitting.prediction import Prediction, energy

_BLOCKS = 48
_TURNS = 2.0
_SCATTER = 0.7
_OF_THE_REST = 0.2
Array = NDArray[np.floating]


def rather_now_and_then(
    before: Sequence[Prediction], after: Sequence[Prediction], floor: float, band_share: float
) -> str | None:
    """Why steady effects are refused that what is measured shows now and then; None where it does all along.

    Arguments: every cut trial beside the prediction without and with the effects; `floor` NRMSE that noise
    alone leaves; `band_share` the judged band over that of the samples.
    """
    noise_n2 = floor**2 * energy([each.measured_n for each in before])
    noise_n2 /= band_share * sum(each.measured_n.size for each in before)
    there, size, whole = _in_blocks(before, after)
    if not size.sum() > 0.0 or not there.sum() > 0.0:
        return None
    gain, mean = there / np.maximum(size, 1e-300), there.sum() / size.sum()
    differs = np.sum(size * (gain - mean) ** 2)
    scatter = (differs - len(size) * noise_n2) / size.sum()
    lent = differs < _OF_THE_REST * np.sum(whole - gain * there)
    if lent or scatter <= (_SCATTER * mean) ** 2:
        return None
    return (
        f"comes and goes: blocks of turns hold {mean:.1f} +- {np.sqrt(scatter):.1f} times what was found, "
        "so it is no steady cause"
    )


def _in_blocks(before: Sequence[Prediction], after: Sequence[Prediction]) -> tuple[Array, Array, Array]:
    """[B] products of what the effects explain with what is left without them, squares of the one and of the
    other, over the blocks of all trials."""
    parts = []
    for one, other in zip(before, after, strict=True):
        wave, left = (
            each - each.mean(axis=0) for each in (other.predicted_n - one.predicted_n, one.residual_n)
        )
        blocks = min(_BLOCKS, int(np.ptp(one.angle_rad) / (2.0 * np.pi * _TURNS)))
        if blocks < 2:
            continue
        for part, found in zip(np.array_split(wave, blocks), np.array_split(left, blocks), strict=True):
            parts.append((np.sum(part * found), np.sum(part**2), np.sum(found**2)))
    there, size, whole = np.reshape(parts, (-1, 3)).T
    return there, size, whole
