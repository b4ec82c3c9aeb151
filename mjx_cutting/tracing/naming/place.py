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
from mjx_cutting.tracing.naming.candidate import Candidate, Contest, beyond_chance, fitted, judged
from mjx_cutting.tracing.naming.chance import CHANCE

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
        contest, effects = self.contest, (*self.beside, kind)
        more, after = self._fitted(effects, starts)
        known = (*self.beside, fewer.kind)
        p = beyond_chance(contest.problem, contest.lines, known, fewer.fit, effects, more, len(starts))
        if p > CHANCE or after.nrmse >= fewer.heldout.nrmse:
            return fewer
        return judged(contest, effects, more, after, self.before, self.before_heldout)

    def instead(self, found: Candidate, kind: type[AbstractEffect], start: NDArray[np.floating]) -> Candidate:
        """A `kind` of as many unknowns, fitted from `start` [U], where that leaves less when held out."""
        effects = (*self.beside, kind)
        other, after = self._fitted(effects, [start])
        if after.nrmse >= found.heldout.nrmse:
            return found
        return judged(self.contest, effects, other, after, self.before, self.before_heldout)

    def _fitted(self, effects: Effects, starts: Sequence[NDArray[np.floating]]) -> tuple[Fit, HeldOut]:
        """The fit from the best of `starts` [U] to all trials, and the error on held-out ones."""
        contest = self.contest
        descent = Descent(contest.problem, effects)
        best = min((descent.descend(start, _STEPS) for start in starts), key=lambda each: each[1])[0]
        return fitted(contest.problem, contest.lines, effects, best, contest.fold)
