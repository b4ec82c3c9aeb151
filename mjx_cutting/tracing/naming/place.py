"""Where an effect has been tried, and whether one of more unknowns does better there than chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import Effects, Fit
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.naming.candidate import Candidate, Contest, beyond_chance, try_effect
from mjx_cutting.tracing.naming.decision import CHANCE

_STEPS = 10
_WORTH_IT = 0.9


@dataclass(frozen=True, eq=False)
class Place:
    """Where a candidate was tried, by the arguments of `candidate.try_effect`."""

    contest: Contest
    beside: Effects
    before: Fit
    before_heldout: HeldOut

    def worth_it(self, found: Candidate) -> bool:
        """Whether the candidate explains enough to ask for more of its kind."""
        return found.heldout.nrmse < _WORTH_IT * self.before_heldout.nrmse

    def better(
        self, fewer: Candidate, kind: type[AbstractEffect], starts: Sequence[NDArray[np.floating]]
    ) -> Candidate:
        """A `kind` of more unknowns, where that explains more than chance adds to the one with `fewer`.

        Arguments: `starts` [n] of unknowns [U] of the whole model.
        """
        problem, lines = self.contest.problem, self.contest.lines
        descent = Descent(problem, (*self.beside, kind))
        best = min((descent.descend(start, _STEPS) for start in starts), key=lambda each: each[1])[0]
        more = try_effect(self.contest, (*self.beside, kind), best, self.before, self.before_heldout)
        known = (*self.beside, fewer.kind)
        p = beyond_chance(problem, lines, known, fewer.fit, (*self.beside, kind), more.fit, len(starts))
        return more if p <= CHANCE and more.heldout.nrmse < fewer.heldout.nrmse else fewer
