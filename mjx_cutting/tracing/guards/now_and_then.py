"""Is what a steady effect explains there all the time, or does it come and go?

A chip that sticks to one tooth for some turns, a loose insert, spikes once a turn: each leaves lines that
runout, pitch or a broken tooth imitate in the mean. But those are there in every turn. So each record is cut
in blocks of several turns, and how much of the effect is in each is asked; where that differs from block to
block about as much as it is large, beyond what noise does, the cause is none that is steady.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mjx_cutting.tracing.fitting.prediction import Prediction, energy

_BLOCKS = 8
_TURNS = 2.0
_SCATTER = 0.7


def rather_now_and_then(
    before: Sequence[Prediction], after: Sequence[Prediction], floor: float, band_share: float
) -> str | None:
    """Why steady effects are refused that what is measured shows now and then; None where it does all along.

    Arguments: every cut trial beside the prediction without and with the effects; `floor` NRMSE that noise
    alone leaves; `band_share` the judged band over that of the samples.
    """
    there, size = [], []
    for one, other in zip(before, after, strict=True):
        wave, left = (
            each - each.mean(axis=0) for each in (other.predicted_n - one.predicted_n, one.residual_n)
        )
        blocks = min(_BLOCKS, int(np.ptp(one.angle_rad) / (2.0 * np.pi * _TURNS)))
        if blocks < 2:
            continue
        for part, found in zip(np.array_split(wave, blocks), np.array_split(left, blocks), strict=True):
            there.append(np.sum(part * found))
            size.append(np.sum(part**2))
    q, p = np.asarray(size), np.asarray(there)
    if not q.sum() > 0.0 or not p.sum() > 0.0:
        return None
    gain, mean = p / np.maximum(q, 1e-300), p.sum() / q.sum()
    noise_n2 = floor**2 * energy([each.measured_n for each in before])
    noise_n2 /= band_share * sum(each.measured_n.size for each in before)
    scatter = np.sum(q * (gain - mean) ** 2) / q.sum() - len(q) * noise_n2 / q.sum()
    if scatter <= (_SCATTER * mean) ** 2:
        return None
    return (
        f"comes and goes: blocks of turns hold {mean:.1f} +- {np.sqrt(scatter):.1f} times what was found, "
        "so it is no steady cause"
    )
