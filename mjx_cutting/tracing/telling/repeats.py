"""Does what a level leaves repeat with the turns of the spindle?

A tool that is always engaged is compared by its level, and no line of its own tells how fast it turned. What
comes once or a few times a turn (a workpiece out of round, the jaws of a chuck, runout, lips that are not
alike) stands at the first multiples of a speed that is near the stated one: each record is turned at that
speed within reach of it at whose multiples there is most. So many speeds as a record can tell apart are as
many tries. (`records.spindle` reads the speed of a cutter from its force, in which tooth passing counts most;
here no multiple is likelier than another.)

The assumption that breaks it: a line that is no multiple of the spindle's, such as mains, and yet within
reach of one in every trial.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.records.comb import SPREAD

MOST_ORDERS = 8
_FINER = 8
_ALL_BUT = 0.9
Array = NDArray[np.floating]


def orders_heard(predictions: Sequence[Prediction]) -> int:
    """How many multiples of every trial's speed its sampling shows."""
    lowest = min((len(p.time_s) - 1) / p.time_s[-1] / p.speed_rev_s for p in predictions)
    return min(MOST_ORDERS, int(0.5 * _ALL_BUT * lowest))


def turned(predictions: Sequence[Prediction], orders: int) -> tuple[list[Prediction], float]:
    """Predictions at the angles of the speeds at whose first `orders` multiples most is left, and the
    logarithm of the number of ways in which those speeds could be chosen."""
    found, ways = [], 0.0
    for each in predictions:
        factor, speeds = _speed(each, orders)
        found.append(replace(each, angle_rad=factor * each.angle_rad))
        ways += float(np.log(speeds))
    return found, ways


def _speed(each: Prediction, orders: int) -> tuple[float, float]:
    """Speed over the stated one, and how many the record tells apart within reach."""
    left = each.residual_n - each.residual_n.mean(axis=0)
    length = _FINER * len(left)
    power = np.sum(np.abs(np.fft.rfft(left, length, axis=0)) ** 2, axis=1)
    step_s = each.time_s[-1] / (len(left) - 1)
    place = np.fft.rfftfreq(length, step_s)
    told = 2.0 * SPREAD * each.speed_rev_s * orders * each.time_s[-1]
    factors = 1.0 + np.linspace(-SPREAD, SPREAD, 2 * round(0.5 * _FINER * told) + 1)
    multiples = np.outer(factors * each.speed_rev_s, np.arange(1, orders + 1))
    most = np.interp(multiples, place, power).sum(axis=1)
    return float(factors[np.argmax(most)]), 1.0 + told
