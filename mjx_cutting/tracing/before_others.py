"""A pass with what comes before all else found in it, because it is about how the records were read.

A spindle that gives way, a force that is late against the measured angle, a ripple which that angle holds.
"""

from __future__ import annotations

from dataclasses import replace

from mjx_cutting.tracing.along.droop import find_droop
from mjx_cutting.tracing.along.offset import find_offset
from mjx_cutting.tracing.along.ripple_in_angle import find_ripple
from mjx_cutting.tracing.along.slow_round import BeforeOthers
from mjx_cutting.tracing.naming.lesser_part import rather_the_rest
from mjx_cutting.tracing.passes import Pass


def with_droop(found: Pass) -> Pass:
    """A spindle that gives way: its lines were read at the loaded speed."""
    return _before_the_others(found, find_droop(found.dataset, found.lines, found.search))


def with_offset(found: Pass) -> Pass:
    """A force that is late against the measured angle: every fit left the phases free. A resonance turns them
    too, so what leaves nearly all that is missing is refused."""
    late = find_offset(found.dataset, found.lines, found.search, found.final, found.before, found.after)
    if late is None or late.round.accepted is None:
        return found
    lesser = rather_the_rest(late.round.before, late.round.accepted.heldout, found.floor_nrmse)
    return found if lesser else _before_the_others(found, late)


def with_ripple(found: Pass) -> Pass:
    """A ripple that the measured angle holds: every fit went along that."""
    return _before_the_others(found, find_ripple(found.dataset, found.lines, found.search, found.after))


def _before_the_others(found: Pass, tried: BeforeOthers | None) -> Pass:
    """The pass with what was tried of how its records were read, where that was accepted."""
    if tried is None or tried.round.accepted is None:
        return found
    named = tried.round.accepted
    return replace(
        found,
        search=replace(found.search, base=tried.base),
        before=tried.before,
        model=found.model.with_effects(named.effect),
        slow=(tried.round, *found.slow),
        evidence=found.evidence | {named.kind.name: tried.evidence},
    )
