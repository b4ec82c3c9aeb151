"""Do steady effects account for what is missing where most of it lies beside the spindle's lines?

A gain that remembers, or wanders, leaves most of its energy between the lines and a little in them; there the
library imitates it, and what differs from trial to trial then is not noise. Effects that take little of all
that is missing are no cause of it.
"""

from __future__ import annotations

from dataclasses import replace

from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.naming.candidate import Round

_LEAST_PART = 0.1


def rather_the_rest(before: HeldOut, after: HeldOut, floor: float) -> str | None:
    """Why steady effects are refused that leave nearly all that is missing; None where they do not.

    Arguments: error on held-out trials without and with everything found; NRMSE that noise alone leaves.
    """
    there, left = (each.nrmse**2 - floor**2 for each in (before, after))
    if there - left >= _LEAST_PART * there:
        return None
    return f"all that was found explains {1.0 - left / there:.0%} of what is missing: the cause is another"


def refused(first: Round, why: str) -> Round:
    """The first round of a search with what passed in it refused after all."""
    candidates = (
        replace(each, decision=replace(each.decision, accepted=False, reasons=(why,)))
        if each.decision.accepted
        else each
        for each in first.candidates
    )
    return replace(first, candidates=tuple(candidates), accepted=None)
