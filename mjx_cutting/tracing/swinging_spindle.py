"""A spindle that gives way within the turn: the pass made again with lines drawn out as its motor has it.

A droop told by the speeds of whole trials says about how far the motor gives way. Whether it does so between
the teeth too is asked of the lines: the model that was found, fitted again beside such a motor. Where that
leaves clearly less, everything is looked for anew beside it, for what it does at tooth passing looks like
unequal pitch, or like a ripple of that order. The lines may tell the droop better than the speeds do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from mjx_cutting.cutting import AbstractEffect, ForceModel
from mjx_cutting.cutting.effects.spindle_droop import SpindleDroop
from mjx_cutting.tracing.along.droop import NAME as DROOP
from mjx_cutting.tracing.along.ends import NAME as ENDS
from mjx_cutting.tracing.along.slow_round import SlowCandidate
from mjx_cutting.tracing.before_others import with_droop
from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.prediction import droop_of, without_droop
from mjx_cutting.tracing.fitting.swinging import AT_ONCE_HZ, Swinging
from mjx_cutting.tracing.naming.intervals import Interval, interval
from mjx_cutting.tracing.passes import Pass, missing, near_floor
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.trials.dataset import Dataset

_STRENGTH = "droop_rev_s_nm"
_CLEARLY_LESS = 0.8
_TIMES_THE_FORCE = 2.0
_STEPS = 12


def with_swing(
    found: Pass, one_pass: Callable[[Dataset, float], Pass], progress: Callable[[str], None]
) -> Pass:
    """The pass beside a motor that swings within the turn, where the trials clearly have one; else `found`.

    Arguments: `found` with droop first of what was found along the trials, or without; `one_pass` makes a
        pass over trials, of a motor of about a droop, rev/s/(N m).
    """
    droop = _droop(found)
    if droop is None or near_floor(found) or not _shows(found, droop):
        return found
    progress("once more, the spindle giving way within the turn")
    again = with_droop(one_pass(found.dataset, droop))
    if _droop(again) is None or missing(again) >= _CLEARLY_LESS * missing(found):
        return found
    return _of_one_droop(again)


def _droop(found: Pass) -> float | None:
    """The droop found, rev/s/(N m), of mills and saws fully in the sheet; None where none was found."""
    if found.dataset.tool.kind in LEVEL_KINDS or found.search.problem.motion is not None:
        return None
    named = {each.kind.name: each.effect for each in found.along}
    if DROOP not in named or ENDS in named:
        return None
    return float(np.asarray(named[DROOP].values()[_STRENGTH]))


def _shows(found: Pass, droop: float) -> bool:
    """Whether the model found leaves clearly less of its lines beside a motor that swings."""
    search = found.search
    given: tuple[type[AbstractEffect], ...] = (*search.problem.given, Swinging)
    problem = replace(search.problem, given=given, droop_rev_s_nm=jnp.asarray(droop))
    x = np.insert(np.asarray(search.final_fit.x), search.problem.common, Swinging.starts(problem.tool)[0])
    _, squares = Descent(problem, search.effects).descend(x, _STEPS)
    return squares < _CLEARLY_LESS * float(search.final_fit.squares)


def _of_one_droop(found: Pass) -> Pass:
    """The pass with one droop in its model, of the bandwidth that the lines have: as the speeds or as the
    lines tell it, whichever is surer."""
    named = found.slow[0].accepted
    assert named is not None
    told = _surer(named, found)
    bandwidth = float(np.asarray(_of(found.model).bandwidth_hz))
    effect = SpindleDroop(told.value, bandwidth)
    decision = replace(named.decision, parameters={_STRENGTH: told})
    one = replace(named, effect=effect, decision=decision)
    far = "at once" if bandwidth > 0.5 * AT_ONCE_HZ else f"up to about {bandwidth:.2g} Hz"
    said = f"the spindle follows the torque within the turn, {far}"
    return replace(
        found,
        model=without_droop(found.model).with_effects(effect),
        slow=(replace(found.slow[0], candidates=(one,), accepted=one), *found.slow[1:]),
        evidence=found.evidence | {DROOP: (*found.evidence.get(DROOP, ()), said)},
    )


def _surer(named: SlowCandidate, found: Pass) -> Interval:
    by_speeds = named.decision.parameters[_STRENGTH]
    fits = found.search.final.fits
    assert fits is not None
    value = float(np.asarray(_of(found.search.final_fit.model).droop_rev_s_nm))
    by_fold = np.asarray(_of(fits.model).droop_rev_s_nm)
    # the torque is known no better than the force is, and the swing is small against it
    error = _TIMES_THE_FORCE * value * found.final.nrmse
    by_lines = interval(named.kind, _STRENGTH, value, by_fold, model_error=error)
    return min(by_speeds, by_lines, key=lambda each: each.high - each.low)


def _of(model: ForceModel) -> SpindleDroop:
    droop = droop_of(model)
    assert droop is not None
    return droop
