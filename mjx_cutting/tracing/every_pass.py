"""Every pass over the trials of a data set, one within the other, and what stands beside the lines.

The tool may move by itself (a pass on its measured path), and records may begin or end in the air or on the
ramps of the sheet (a pass over the part of them that is in the cut). What is left is then asked for what no
pass over lines at multiples of the spindle's frequency sees: a loop in the air, vibration, droop, a force the
torque does not know, a ripple in the angle.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mjx_cutting.cutting import AbstractEffect, effect_class
from mjx_cutting.cutting.effects.material_periodicity import MaterialPeriodicity
from mjx_cutting.cutting.effects.torque_ripple import TorqueRipple as RIPPLE
from mjx_cutting.tracing.along.droop import NAME as DROOP
from mjx_cutting.tracing.along.ends import NAME as ENDS
from mjx_cutting.tracing.along.engaged import (
    SURELY_TURNS,
    Engaged,
    at_places_of_their_own,
    engaged,
    mostly_in_the_cut,
)
from mjx_cutting.tracing.along.fed import may_be_followed
from mjx_cutting.tracing.along.flutes import FLUTES
from mjx_cutting.tracing.along.offset import NAME as OFFSET
from mjx_cutting.tracing.along.offset import as_late, delay_s
from mjx_cutting.tracing.along.presliding import HYSTERESIS
from mjx_cutting.tracing.along.selfexcited import NAME as VIBRATION
from mjx_cutting.tracing.along.selfexcited import find_vibration
from mjx_cutting.tracing.along.slow_kinds import BY_PLACE
from mjx_cutting.tracing.along.stair import STAIR
from mjx_cutting.tracing.along.turning_chatter import find_chatter
from mjx_cutting.tracing.before_others import with_droop, with_offset, with_ripple
from mjx_cutting.tracing.by_place import in_ramps
from mjx_cutting.tracing.droop_on_ramps import with_droop_on_ramps
from mjx_cutting.tracing.entered import entered
from mjx_cutting.tracing.fitting.measured_path import pose_on_path, steady_cuts
from mjx_cutting.tracing.loop_in_air import loop_in_air
from mjx_cutting.tracing.naming.chance import gain_over_trials
from mjx_cutting.tracing.once import once
from mjx_cutting.tracing.passes import Pass, near_floor
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.sheet import begin_in_air, inside_the_sheet
from mjx_cutting.tracing.swinging_spindle import with_swing
from mjx_cutting.tracing.telling.ties import TIED
from mjx_cutting.trials.dataset import Dataset


def every_pass(
    dataset: Dataset,
    band_hz: tuple[float, float],
    kinds: Sequence[type[AbstractEffect]],
    seed: int,
    progress: Callable[[str], None],
) -> tuple[Pass, Engaged | None]:
    """What is found of `kinds` on the trials, and where in them it was looked for, if not over their whole
    length (call it in float64). Where the force is late against the measured angle, so it is against the
    measured feed and place."""
    found, part = _passes(dataset, band_hz, kinds, seed, progress)
    late_s = delay_s(found.model)
    bound = any(each.kind.name in (STAIR.name, *BY_PLACE) for each in found.along)
    if not late_s or not (bound or (may_be_followed(dataset) and not near_floor(found))):
        return found, part
    progress("once more, with feed and place as late as the force")
    other, its_part = _passes(as_late(dataset, late_s), band_hz, kinds, seed, progress)
    known = any(each.kind.name == OFFSET for each in other.along)
    return (other, its_part) if known and other.final.nrmse <= found.final.nrmse else (found, part)


def _passes(
    dataset: Dataset,
    band_hz: tuple[float, float],
    kinds: Sequence[type[AbstractEffect]],
    seed: int,
    progress: Callable[[str], None],
) -> tuple[Pass, Engaged | None]:
    """`every_pass` on feed and place as they were recorded."""
    named = {kind.name for kind in kinds}
    # droop is not in lines read at the loaded speed, but in where they stand; flutes fill along the hole
    elsewhere = {DROOP, FLUTES.name} if dataset.tool.kind in LEVEL_KINDS else {DROOP}
    steady = [kind for kind in kinds if kind.steady and kind.name not in elsewhere]
    dataset, on_path = steady_cuts(dataset)

    def one_pass(trials: Dataset, droop_rev_s_nm: float = 0.0) -> Pass:
        return once(trials, band_hz, kinds, steady, seed, progress, droop_rev_s_nm=droop_rev_s_nm)

    found = part = None
    if on_path:
        progress("on the measured path of the tool")
        bare = once(dataset, band_hz, (), (), seed, progress)
        found = _if_better(once(dataset, band_hz, kinds, steady, seed, progress, pose_on_path), bare)
    if found is None:

        def by_parts(trials: Dataset) -> tuple[Pass, Engaged | None]:
            return _by_parts(trials, band_hz, one_pass, ENDS in named, seed, progress)

        found, part = by_parts(dataset)
        if HYSTERESIS.name in named:
            found = loop_in_air(dataset, found, lambda rest: by_parts(rest)[0], progress)
    if VIBRATION in named:
        progress("lines off the spindle's multiples")
        found = _with_vibration(found)
    if DROOP in named:
        found = with_droop_on_ramps(dataset, with_swing(with_droop(found), one_pass, progress))
    if OFFSET in named and found.search.problem.motion is None:
        found = with_offset(found)
    if RIPPLE in kinds and RIPPLE not in found.kinds and found.search.problem.motion is None:
        found = with_ripple(found)
    return found, part


def _by_parts(
    trials: Dataset,
    band_hz: tuple[float, float],
    one_pass: Callable[[Dataset], Pass],
    with_ends: bool,
    seed: int,
    progress: Callable[[str], None],
) -> tuple[Pass, Engaged | None]:
    """What `one_pass` finds on the trials whole, or on the part of them that is in the sheet or the cut."""
    if with_ends and at_places_of_their_own(trials):
        progress("where each tool is in the sheet")
        return _where_engaged(once(trials, band_hz, (), (), seed, progress), one_pass, with_ends)
    found = None
    begins, cut = with_ends and begin_in_air(trials), with_ends and mostly_in_the_cut(trials)
    if begins or cut:
        # whatever else a pass over ramps and air found would be looked for once more inside the sheet
        progress("where the tool is in the sheet")
        bare = once(trials, band_hz, [effect_class(ENDS)], (), seed, progress)
        inside = inside_the_sheet(bare, one_pass) if begins else bare
        found = None if inside is bare else inside
        if cut and found is None and not (_knows_the_ends(bare) or near_floor(bare)):
            return _where_engaged(bare, one_pass, with_ends)
    if found is None:
        found = inside_the_sheet(one_pass(trials), one_pass)
    return _where_engaged(in_ramps(found, band_hz, seed, progress), one_pass, with_ends)


def _where_engaged(
    found: Pass, one_pass: Callable[[Dataset], Pass], with_ends: bool
) -> tuple[Pass, Engaged | None]:
    """What was found, or where more than noise is left and records begin or end in the air, what `one_pass`
    finds where their tools are in the cut; `with_ends` the ramps too, if they are as geometry has them. What
    was found with the ends of the sheet in it stays where that leaves more: of records that are mostly ramp,
    little is cut fully."""
    if found.dataset.tool.kind in LEVEL_KINDS or near_floor(found):
        return found, None
    known = _knows_the_ends(found)
    part = engaged(found.dataset, SURELY_TURNS if known else 0.0)
    if part is None:
        return found, None
    inside = one_pass(part.dataset)
    inside = entered(found, inside, part, one_pass) if with_ends else inside
    return (found, None) if known and found.final.nrmse < inside.final.nrmse else (inside, part)


def _knows_the_ends(found: Pass) -> bool:
    return any(kind.name == ENDS for kind in found.kinds)


def _if_better(moved: Pass, bare: Pass) -> Pass | None:
    """The pass on the measured path, where held-out trials say that it tells clearly more than the `bare`
    base model on a straight one. That stays the error before: it knows nothing of how the tool moves."""
    gain, error = gain_over_trials(bare.final, moved.final)
    if not gain > TIED * error:
        return None
    search = replace(moved.search, base=bare.search.base)
    return replace(moved, search=search, base_model=bare.base_model, before=bare.before)


def _with_vibration(found: Pass) -> Pass:
    """Vibration that the cut itself keeps up, of which the frequency is told and no model made."""
    if found.dataset.tool.kind in LEVEL_KINDS:
        shaken = find_chatter(found.dataset, found.lines.band_hz, found.after, found.final)
    else:
        weight = np.asarray(found.search.problem.weight)
        feed = {trial.file: trial.feed_speed_m_s for trial in found.dataset.trials}
        waves = [each.effect for each in found.along if isinstance(each.effect, MaterialPeriodicity)]
        waves_hz = np.array([[feed[each.file] / wave.wavelength_m for wave in waves] for each in found.after])
        shaken = find_vibration(found.dataset, found.lines, found.after, found.final, weight, waves_hz)
    if shaken is None:
        return found
    return replace(found.with_round(shaken.round, shaken.evidence), model=found.model)
