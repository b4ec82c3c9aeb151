"""Noise that grows with the force: what is left is noise, though more than the air shows.

An amplifier's ripple, a gain that trembles from sample to sample: the sample's variance is a + g F^2. Read in
the air, the noise floor is too low for the cut, and a model that lacks nothing would be called unexplained.
What is left counts as such noise where its size goes with the force, and where, in units of that size, it is
Gaussian and alike at all frequencies of the band, and little of it the mean of a trial, but for a factor of
its own as small as cuts differ by (`own_factor`): a force that is missing, chips cut twice, a tooth that
moves, are slower than the samples; spikes are rare.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from mjx_cutting.tracing.fitting.prediction import Prediction, energy
from mjx_cutting.tracing.records.noise import periodogram
from mjx_cutting.tracing.telling.own_factor import SCATTER, own_factors

_GROWN = 0.3
_KURTOSIS = 4.5
_BINS = 12
_COLOUR = 0.1
_MEAN = 0.25
_FEWEST = 256
Array = NDArray[np.floating]


def growing_noise(left: Sequence[Prediction], rate_hz: float, band_hz: tuple[float, float]) -> float | None:
    """What of the force is left, as a share, where that is noise that grows with the force; else None.

    Arguments: `left` the cut trials beside the model's predictions.
    """
    if min(len(each.residual_n) for each in left) < _FEWEST:
        return None
    factors = own_factors(left)
    alike = factors.without if factors.size < SCATTER else tuple(left)
    grown = False
    for axis in range(3):
        own = [(each.residual_n[:, axis], _force(each)[:, axis]) for each in alike]
        if not any(residual.any() for residual, _ in own):
            continue
        size = _size(own)
        if size is None:
            return None
        level, gain = size
        unit = [residual / np.sqrt(level + gain * force**2) for residual, force in own]
        if not (_gaussian(unit) and _without_mean(unit) and _white(unit, rate_hz, band_hz)):
            return None
        force2 = float(np.mean(np.concatenate([force for _, force in own]) ** 2))
        grown = grown or gain * force2 > _GROWN * level
    if not grown:
        return None
    whole = energy([_force(each) for each in left])
    return float(np.sqrt(energy([each.residual_n for each in left]) / max(whole, 1e-300)))


def _force(each: Prediction) -> Array:
    """[T, 3] the force of the model without the trial's bias, N."""
    return each.predicted_n - each.bias_n


def _size(own: Sequence[tuple[Array, Array]]) -> tuple[float, float] | None:
    """a and g of the variance a + g F^2, N^2 and 1; None where it has no constant part."""
    square = np.concatenate([residual for residual, _ in own]) ** 2
    force2 = np.concatenate([force for _, force in own]) ** 2
    unit = max(float(force2.mean()), 1e-300)
    (level, gain), _ = nnls(np.stack([np.ones_like(force2), force2 / unit], axis=1), square)
    return (float(level), float(gain / unit)) if level > 0.0 else None


def _gaussian(unit: Sequence[Array]) -> bool:
    """Whether deviations in units of their own size have no long tails."""
    each = np.concatenate(unit)
    return bool(np.mean(each**4) < _KURTOSIS * np.mean(each**2) ** 2)


def _without_mean(unit: Sequence[Array]) -> bool:
    """Whether little of them is the mean of a trial."""
    means = sum(len(each) * float(each.mean()) ** 2 for each in unit)
    return bool(means < _MEAN * sum(float(np.sum(each**2)) for each in unit))


def _white(unit: Sequence[Array], rate_hz: float, band_hz: tuple[float, float]) -> bool:
    """Whether they are alike at all frequencies of the band, in a dozen parts of it."""
    power = np.zeros(_BINS)
    for each in unit:
        spectrum, inside = periodogram(each[:, None], rate_hz, band_hz)
        power += [float(part.mean()) for part in np.array_split(spectrum[inside], _BINS)]
    above = np.maximum(power - np.median(power), 0.0)
    return bool(above.sum() < _COLOUR * power.sum())
