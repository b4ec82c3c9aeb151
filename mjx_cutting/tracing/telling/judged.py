"""The errors by which the word of a verdict is chosen, where those on held-out trials are not enough.

Thrust and torque of a drill have no common unit, and what is larger in number would speak for both: each
counts as a share of itself. Of a sensor zeroed before every trial each record has a zero of its own; where
most show no air beside the cut, a level tells the zero as well as the force, and only what changes within the
trials counts, unless levels are off by more than a tenth of the force: that is no zero.

The assumption that breaks it: that what moves the levels a little is the zero. An effect that does may hide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.prediction import Prediction, energy
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.telling.unlike_chips import SCATTER as CHIPS

_MOST_OF_A_ZERO = 0.1


@dataclass(frozen=True)
class Judged:
    """The errors of the models `before` and `after`, as shares of the force.

    Fields: `floor` of the noise; `own_zero` share that the zeros of the trials are, 0 where they are known;
    `apart`: each axis is a share of itself; `unlike` what is left between the lines, if chips are not alike,
    and is then the floor for what a name leaves; `noise` without it, for what asks for one.
    """

    before: float
    after: float
    floor: float
    own_zero: float = 0.0
    apart: bool = False
    unlike: float | None = None
    noise: float = 0.0

    def less(self, share: float, everywhere: bool) -> Judged:
        """The same, a `share` of the energy that the model found leaves not counted; nor, if `everywhere`, of
        what is left without what was found."""
        times = float(np.sqrt(1.0 - share))
        before = self.before * times if everywhere else self.before
        return replace(self, before=before, after=self.after * times)

    @property
    def chips(self) -> str | None:
        """In words, that chips are not alike."""
        if self.unlike is None:
            return None
        return (
            f"between the lines {self.unlike:.1%} of the force is left, where noise is {self.noise:.1%}: "
            f"chips that are not alike, which up to {CHIPS:.0%} of the force counts as noise"
        )

    @property
    def by_axis(self) -> str | None:
        """In words, what is left where each axis counts as a share of itself."""
        if not self.apart:
            return None
        return (
            f"thrust and torque, each as a share of itself, are left by {self.after:.1%}, and noise is "
            f"{self.noise:.1%}"
        )

    @property
    def zeros(self) -> str | None:
        """In words, that the zeros of the trials are not known."""
        if not self.own_zero:
            return None
        return (
            f"the level of each trial is off by {self.own_zero:.1%} of the force in a way of its own, which "
            "its zero may be: the sensor was zeroed before every trial, and too few records show the air "
            "beside the cut; begin them before the tool touches"
        )


def judged(
    kind: str,
    zeros_known: bool,
    errors: tuple[HeldOut, HeldOut],
    predicted: tuple[Sequence[Prediction], Sequence[Prediction]],
    noise: float,
    unlike: float | None = None,
) -> Judged:
    """What the word is chosen by.

    Arguments:
        kind: of the tool; `zeros_known` whether the zero of every trial is.
        errors, predicted: of the model without and with what was found.
        noise: as a share of the force; of a drill the mean over thrust and torque.
        unlike: what is left between the lines, where chips are not alike (`unlike_chips`).
    """
    shares = [_in_shares(each) if kind == "drill" else each.nrmse for each in errors]
    floor = unlike or noise
    known = Judged(shares[0], shares[1], floor, apart=kind == "drill", unlike=unlike, noise=noise)
    if kind not in LEVEL_KINDS or zeros_known:
        return known
    before, after = (in_shares(each) if kind == "drill" else each for each in predicted)
    zero = _of_levels(after)
    if zero > _MOST_OF_A_ZERO:
        return known
    return replace(known, before=_within(before), after=_within(after), own_zero=zero)


def in_shares(predicted: Sequence[Prediction]) -> tuple[Prediction, ...]:
    """The trials with every axis as a share of what was measured of it in all of them."""
    size = np.sqrt(np.mean([np.mean(each.measured_n**2, axis=0) for each in predicted], axis=0))
    by = np.where(size > 0.0, size, 1.0)
    return tuple(
        replace(
            each,
            measured_n=each.measured_n / by,
            predicted_n=each.predicted_n / by,
            bias_n=each.bias_n / by,
        )
        for each in predicted
    )


def _in_shares(error: HeldOut) -> float:
    measured: NDArray[np.bool_] = error.energy_n2.sum(axis=0) > 0.0
    return float(np.sqrt(np.mean(error.per_axis[measured] ** 2)))


def _within(predicted: Sequence[Prediction]) -> float:
    left = [each.residual_n - each.residual_n.mean(axis=0) for each in predicted]
    return _share(left, predicted)


def _of_levels(predicted: Sequence[Prediction]) -> float:
    left = [np.broadcast_to(each.residual_n.mean(axis=0), each.residual_n.shape) for each in predicted]
    return _share(left, predicted)


def _share(left: Sequence[NDArray[np.floating]], predicted: Sequence[Prediction]) -> float:
    return float(np.sqrt(energy(left) / max(energy([each.measured_n for each in predicted]), 1e-300)))
