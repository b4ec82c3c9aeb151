"""What comes back at a rate of its own, neither the spindle's nor the teeth's: strikes, pulses, a belt.

Such a thing has several multiples of one low frequency, the lowest among them. That frequency goes with the
speed, where a bearing, a gear or a belt turns with the spindle; it stays, where a pump or a fan runs by
itself; or it goes with the feed, where the sheet has a pattern. Which of these is told where speeds and feeds
differ among the trials that show it; the speeds must. A vibration that keeps itself up has no such lowest
line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.trials.dataset import Dataset

_FAR_ABOVE = 20.0
_RESOLVED = 2.0
_FEWEST_PERIODS = 8
_MULTIPLES = 10
_FEWEST_MULTIPLES = 3
_FEWEST_TRIALS = 3
_MOST_OF_THEM = 0.6
_AROUND = 40
_ROUNDING = 1e-12
_SAME = 0.015
Array = NDArray[np.floating]


@dataclass(frozen=True)
class OwnRate:
    """What comes back at a rate of its own.

    Fields: `rates` how often in one "turn", "second" or "metre", by each of these that it may go with;
    `lowest_hz` [R] the lowest line of each trial that shows it, 0 where none does; `multiples` how many of
    them are heard.
    """

    rates: dict[str, float]
    lowest_hz: Array
    multiples: int

    def __str__(self) -> str:
        """How often it comes back, in words."""
        told = [
            f"every {1e3 / rate:.3g} mm of the path" if per == "metre" else f"{rate:.4g} times a {per}"
            for per, rate in self.rates.items()
        ]
        return " or ".join(told)


def own_rate(dataset: Dataset, predicted: Sequence[Prediction]) -> OwnRate | None:
    """What comes back in most trials of what a model leaves; None where in fewer than three, or at no rate
    that they share.

    Arguments: the trials, and what the model predicts of them, by the same files.
    """
    heard = [_combs(each) for each in predicted]
    feed_m_s = {trial.file: trial.feed_speed_m_s for trial in dataset.trials}
    bases = {
        "turn": np.array([each.speed_rev_s for each in predicted]),
        "second": np.ones(len(predicted)),
        "metre": np.array([feed_m_s[each.file] for each in predicted]),
    }
    found = [each for base in bases.values() if (each := _shared(heard, bases, base)) is not None]
    return max(found, key=lambda each: (np.count_nonzero(each.lowest_hz), each.multiples), default=None)


def _shared(heard: Sequence[dict[float, int]], bases: dict[str, Array], base: Array) -> OwnRate | None:
    """What most trials have as often in one of the `base`, at more than one speed."""
    found = []
    for rate in {low / base[i] for i, combs in enumerate(heard) for low in combs}:
        lows = [_nearest(combs, rate * at) for combs, at in zip(heard, base, strict=True)]
        same = np.abs(np.array(lows) / (rate * base) - 1.0) < _SAME
        if same.sum() < max(_FEWEST_TRIALS, _MOST_OF_THEM * len(heard)):
            continue
        lowest = np.where(same, lows, 0.0)
        ratios = {per: lowest[same] / each[same] for per, each in bases.items()}
        rates = {
            per: float(each.mean())
            for per, each in ratios.items()
            if np.ptp(each) < 2.0 * _SAME * each.mean()
        }
        if {"turn", "second"} <= set(rates):
            continue
        counts = [combs[low] for combs, low, own in zip(heard, lows, same, strict=True) if own]
        closely = float(np.sum(np.abs(lowest[same] / (rate * base[same]) - 1.0)))
        found.append((sum(counts), -closely, OwnRate(rates, lowest, int(np.median(counts)))))
    return max(found, key=lambda each: each[:2])[2] if found else None


def _nearest(combs: dict[float, int], at_hz: float) -> float:
    return min(combs, key=lambda low: abs(low - at_hz), default=np.inf)


def _combs(trial: Prediction) -> dict[float, int]:
    """Frequencies with multiples of their own far above the noise, and how many of these are heard."""
    time = trial.time_s
    left = trial.residual_n - trial.residual_n.mean(axis=0)
    left = left[:, np.ptp(left, axis=0) > 0.0]
    if not left.size:
        return {}
    window = np.hanning(len(time))[:, None]
    power = np.abs(np.fft.rfft(left * window, axis=0)) ** 2
    noise = median_filter(power, size=(2 * _AROUND + 1, 1), mode="nearest")
    over = np.mean(power / np.maximum(noise, _ROUNDING * power.max(axis=0)), axis=1)
    step_hz = (len(time) - 1) / (len(time) * time[-1])
    place = step_hz * np.arange(len(over))
    away = np.abs(place - trial.speed_rev_s * np.round(place / trial.speed_rev_s))
    over[away < _RESOLVED * step_hz] = 0.0
    peak = np.zeros(len(over), bool)
    peak[1:-1] = (over[1:-1] > over[:-2]) & (over[1:-1] >= over[2:]) & (over[1:-1] > _FAR_ABOVE)
    lines = place[peak]
    found = {}
    # a speed that is not quite the stated one comes back a whole number of times a turn
    turns = lines / trial.speed_rev_s
    own = np.abs(turns - np.round(turns)) > _SAME * turns
    for low in lines[own & (lines > _FEWEST_PERIODS / time[-1]) & (lines < place[-1] / _FEWEST_MULTIPLES)]:
        times = np.arange(1, _MULTIPLES + 1)
        off = np.abs(lines[:, None] - low * times)
        # the lowest is known to half a step, its k-th multiple to k halves
        hit = np.any(off < (1.0 + 0.5 * times) * step_hz, axis=0)
        if hit[:2].all() and hit.sum() >= _FEWEST_MULTIPLES:
            highest = int(times[hit].max())
            found[float(lines[np.argmin(off[:, highest - 1])]) / highest] = int(hit.sum())
    return found
