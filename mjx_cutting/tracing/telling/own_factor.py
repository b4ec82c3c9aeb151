"""By how much of itself the force of each trial is larger than predicted, as a whole.

No two sheets, and no two cuts in one, are quite alike, and a sensor's gain is not the same every day. A force
larger by some hundredths in one trial than in another is no shape that the model lacks, though it leaves
lines at tooth passing and ties the axes together. So those are looked for in what is left without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.fitting.prediction import Prediction, energy
from mjx_cutting.tracing.guards.own_gain import SURELY, by_chance

SCATTER = 0.02
"""What two cuts of one sheet may differ by as a whole: a limit we set."""
_MOVING = 0.01
_SHOWN = 1e-6
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class OwnFactors:
    """A factor a trial.

    Fields: `factor` [R] by how much of itself each force is larger than predicted, `size` their root mean
    square over the force; `share` of the energy left that this is; `without` it, the predictions.
    """

    factor: Array
    size: float
    share: float
    without: tuple[Prediction, ...]


def own_factors(predictions: Sequence[Prediction]) -> OwnFactors:
    """The factors, read from what changes within the trials, where it does: the mean may be a bias. Where one
    bias is that of all, the factor of a trial in which nothing changes is read from its mean; else such a
    trial, of which every line lies beyond the band, tells none. What the factors do to the mean is taken away
    as well where that leaves less."""
    force = [each.predicted_n - each.bias_n for each in predictions]
    moving = [each - each.mean(axis=0) for each in force]
    bias = np.stack([each.bias_n for each in predictions])
    one_zero = bool(np.all(np.ptp(bias, axis=0) <= 1e-9 * np.abs(bias).max()))
    read = force
    if energy(moving) > _MOVING * energy(force):
        read = [
            whole if one_zero and energy([part]) <= _MOVING * energy([whole]) else part
            for part, whole in zip(moving, force, strict=True)
        ]
    left = [each.residual_n for each in predictions]
    size = np.array([float(np.sum(each**2)) for each in read])
    product = np.array([float(np.sum(a * b)) for a, b in zip(read, left, strict=True)])
    shown = size > _SHOWN * size.max(initial=0.0)
    factor = np.where(shown, product, 0.0) / np.where(shown, size, 1.0)
    ways = [[own * each for own, each in zip(factor, shape, strict=True)] for shape in (read, force)]
    told = min(ways, key=lambda way: energy([a - b for a, b in zip(left, way, strict=True)]))
    without = tuple(
        replace(each, predicted_n=each.predicted_n + more)
        for each, more in zip(predictions, told, strict=True)
    )
    share = 1.0 - energy([each.residual_n for each in without]) / max(energy(left), 1e-300)
    mean = float(np.sqrt(np.sum(product * factor) / max(size.sum(), 1e-300)))
    return OwnFactors(factor, mean, share, without)


def followed(before: Sequence[Prediction], after: Sequence[Prediction], size: int) -> bool:
    """Whether effects of `size` unknowns leave so little of the factors that those are surely no scatter."""
    factors, left = own_factors(before), own_factors(after)
    share = 1.0 - (left.size / max(factors.size, 1e-300)) ** 2
    return by_chance(share, size, len(before)) < SURELY
