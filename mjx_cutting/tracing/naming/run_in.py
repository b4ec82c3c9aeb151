"""Wear that runs in: a sharp edge wears fast at first, then steadily.

Wear that grows evenly is tried first, because two unknowns less leave more to be sure of. Where its land
leaves more than noise, it is fitted with the run-in as well, and kept so where that explains more than chance
does. Without this, force that rises fast and then slowly is a sensor's drift rather than wear.
"""

from __future__ import annotations

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mjx_cutting.cutting import Tool
from mjx_cutting.cutting.effects.flank_wear import RATE, FlankWear
from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import Effects, Fit
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.naming.candidate import Candidate, Contest, beyond_chance, try_effect
from mjx_cutting.tracing.naming.decision import CHANCE

_SHARES = (0.03, 0.1, 0.3)
_STEPS = 10
_WORTH_IT = 0.9


class WearRunningIn(FlankWear):
    """Flank wear with a run-in. Only kappa times the land shows, so the land at the longest length cut,
    `longest_m`, is held at what even wear makes there. Coordinates: kappa as of `FlankWear`, the share of
    that land that runs in (logit), the length it takes (logarithm, m)."""

    longest_m: ClassVar[float]

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 5

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> WearRunningIn:
        steady = FlankWear.build(coordinates[:3], tool)
        share, length = jax.nn.sigmoid(coordinates[3]), jnp.exp(coordinates[4])
        land = share * RATE * cls.longest_m / -jnp.expm1(-cls.longest_m / length)
        return cls(steady.kappa_n_m2, (1.0 - share) * RATE, initial_m=land, run_in_m=length)

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[0.3, 0.5, 0.3, 0.0, np.log(0.1 * cls.longest_m)]])


def with_run_in(
    found: Candidate, contest: Contest, effects: Effects, before: Fit, before_heldout: HeldOut
) -> Candidate:
    """The candidate `found`, or wear with its run-in where that is steady wear and the run-in explains more.

    Arguments: those of `candidate.try_effect`, by which `found` was tried.
    """
    if found.kind is not FlankWear or not found.heldout.nrmse < _WORTH_IT * before_heldout.nrmse:
        return found
    problem = contest.problem
    longest_m = float(np.max(np.asarray(problem.cut.cut_length_m)))
    kind = type("WearRunningIn", (WearRunningIn,), {"longest_m": longest_m})
    running_in: Effects = (*effects[:-1], kind)
    descent = Descent(problem, running_in)
    steady = np.asarray(found.fit.x)
    starts = [np.append(steady, [0.0, np.log(share * longest_m)]) for share in _SHARES]
    best = min((descent.descend(start, _STEPS) for start in starts), key=lambda each: each[1])[0]
    more = try_effect(contest, running_in, best, before, before_heldout)
    p = beyond_chance(problem, contest.lines, effects, found.fit, running_in, more.fit, len(starts))
    return more if p <= CHANCE and more.heldout.nrmse < found.heldout.nrmse else found
