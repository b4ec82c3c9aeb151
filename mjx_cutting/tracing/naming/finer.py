"""What was tried with few unknowns, and explains much, told more finely where the trials show it."""

from __future__ import annotations

from mjx_cutting.tracing.fitting.fit import Effects, Fit
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.naming.axis_apart import axis_apart
from mjx_cutting.tracing.naming.by_direction import by_direction
from mjx_cutting.tracing.naming.candidate import Candidate, Contest
from mjx_cutting.tracing.naming.gradual import gradually
from mjx_cutting.tracing.naming.place import Place
from mjx_cutting.tracing.naming.wear_stages import in_stages

_WAYS = (in_stages, axis_apart, gradually, by_direction)


def finer(
    found: Candidate, contest: Contest, effects: Effects, before: Fit, before_heldout: HeldOut
) -> Candidate:
    """The candidate `found`, or one of its kind with more unknowns where they explain more.

    Arguments: those of `candidate.try_effect`, by which `found` was tried.
    """
    place = Place(contest, effects[:-1], before, before_heldout)
    for way in _WAYS:
        found = way(found, place)
    return found
