"""What was tried along the trials: a candidate, a round of them, and the trials less what was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.naming.decision import Decision
from mjx_cutting.tracing.records.course import Course

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class SlowCandidate:
    """A slow effect tried: as fitted, its held-out error, the decision; what it adds to each trial, N, beside
    a steady model fitted without it (`added_n`), and by itself (`whole_n`); `short_of_free` where all that
    refuses it is that force free in position does better; its `shape` [d]; the share by which its strength
    may be off as the steady model is (`unsure`)."""

    kind: type[AbstractEffect]
    effect: AbstractEffect
    heldout: HeldOut
    decision: Decision
    added_n: tuple[Array, ...]
    whole_n: tuple[Array, ...] = ()
    short_of_free: bool = False
    shape: Array = field(default_factory=lambda: np.zeros(0))
    unsure: float = 0.0


@dataclass(frozen=True, eq=False)
class SlowRound:
    """One round: error before, the candidates in order of held-out error, and the one accepted, if any."""

    before: HeldOut
    candidates: tuple[SlowCandidate, ...]
    accepted: SlowCandidate | None

    @property
    def runner_up(self) -> SlowCandidate | None:
        """The best candidate that was not accepted."""
        return next((each for each in self.candidates if each is not self.accepted), None)


@dataclass(frozen=True, eq=False)
class BeforeOthers:
    """What was tried of how the records were read, and so comes before all else that was found in them: its
    round, the base model's error and predictions where they are read without it, and what speaks for it."""

    round: SlowRound
    base: HeldOut
    before: tuple[Prediction, ...]
    evidence: tuple[str, ...]


def less_force(trials: Sequence[Course], force_n: Sequence[Array]) -> list[Course]:
    """The trials less [T, 3] a force in each."""
    return [replace(each, left_n=each.left_n - force) for each, force in zip(trials, force_n, strict=True)]


def without(trials: Sequence[Course], found: SlowCandidate) -> list[Course]:
    """The trials less what was found."""
    return less_force(trials, found.added_n)


def less(trials: Sequence[Course], rounds: Sequence[SlowRound]) -> Sequence[Course]:
    """The trials less all that was accepted."""
    for each in rounds:
        trials = trials if each.accepted is None else without(trials, each.accepted)
    return trials
