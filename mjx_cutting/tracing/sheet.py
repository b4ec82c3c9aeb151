"""Records that begin or end outside the sheet: traced where the tool is fully engaged, judged whole.

A steady model fitted to records that hold the ramps at the ends of the sheet is wrong everywhere by a little.
So once `ends` has found where the sheet begins or ends, the records are cut down to where the tool is fully
in it, everything is traced on those, and what the geometry says is missing in the rest is held against the
whole records.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing.along.ends import NAME, Ramps, effect_at, like_geometry, met_by, places_of
from mjx_cutting.tracing.along.engaged import cut_down, touches_m
from mjx_cutting.tracing.along.slow_round import SlowCandidate, SlowRound
from mjx_cutting.tracing.naming.intervals import interval
from mjx_cutting.tracing.passes import Pass, near_floor
from mjx_cutting.tracing.records.course import along_path, felt_at
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.line_gain import filter_delay_s
from mjx_cutting.tracing.records.lines import Lines
from mjx_cutting.tracing.whole_records import Told, closest, held_against, met, outside_the_cut, with_ends
from mjx_cutting.trials.dataset import Dataset

_FEWEST = 4
_FEWEST_IN_AIR = 10
_CLEAR = 0.01
_AT_ONE_PLACE = 0.1
_SAMPLES_PER_LINE = 3
_CLOSER = (1.0, 0.2, 0.04, 0.008)
_STEP = 0.05
Array = NDArray[np.floating]
Ends = tuple[float, float, float]


def begin_in_air(dataset: Dataset) -> bool:
    """Whether most records show where the tool touches the sheet first, so that its ends are to be looked for
    before all else."""
    if dataset.tool.kind in LEVEL_KINDS:
        return False
    touched = np.isfinite(touches_m(dataset))
    return int(touched.sum()) >= max(_FEWEST, len(touched) / 2)


def inside_the_sheet(found: Pass, one_pass: Callable[[Dataset], Pass]) -> Pass:
    """What was found, or if the sheet ends within the records, what `one_pass` finds on the rest of them.

    A first model does not tell whether rim or axis meets the ends: where that differs, both are tried, unless
    the first leaves no more than noise.
    """
    first = _ends_of_sheet(found.slow)
    if first is None:
        return found
    reach = Ramps(found.lines, found.search.problem, found.model).reach_m
    ends = places_of(first.effect)
    ways = [ends] if len(met_by(reach)) == 1 else [ends, _met_otherwise(ends, float(np.median(reach)))]
    traced: list[Pass] = []
    for way in ways:
        inside = _traced_inside(found, first, way, reach, one_pass)
        if inside is not None:
            traced.append(inside)
            if near_floor(inside):
                break
    return min(traced, key=lambda each: each.final.nrmse, default=found)


def _met_otherwise(ends: Ends, reach_m: float) -> Ends:
    """The same ends met by the rim where they were by the axis, the other way round where not."""
    start, end, by_axis = ends
    away = reach_m if by_axis == 0.0 else -reach_m
    return start + away, end + away, 1.0 - by_axis


def _traced_inside(
    found: Pass, first: SlowCandidate, ends: Ends, reach: Array, one_pass: Callable[[Dataset], Pass]
) -> Pass | None:
    """What `one_pass` finds between the `ends`, held against the whole records; None where they do not show
    them, or too little is left."""
    start, _, by_axis = ends
    if not _at_one_place(found.dataset, start, reach):
        return None
    low = first.decision.parameters["start_m"].low - float(first.effect.values()["start_m"])
    touched = start + min(low, 0.0)
    dataset = _zeroed_in_air(found.dataset, touched - (by_axis + _CLEAR) * reach)
    rest, kept = _engaged(dataset, found.lines, ends, reach)
    if len(kept) < max(_FEWEST, len(reach) / 2):
        return None
    inside = one_pass(rest)
    tried = next(len(each.candidates) for each in found.slow if first in each.candidates)
    whole, told = _judged_whole(dataset, inside, first, ends, tried)
    if whole.accepted is None:
        return None
    start, end, by_axis = places_of(whole.accepted.effect)
    sentence = "everything else was traced where the tool is fully in the sheet"
    if np.isfinite(start):
        sentence += f", which {met(start, by_axis)}; the way in takes up to {1e3 * reach.max():.1f} mm"
    if np.isfinite(end):
        sentence += f"; the sheet ends at {1e3 * end:.2f} mm"
    return with_ends(inside, whole, told, sentence, found.search.base.error_n2[kept])


def _at_one_place(dataset: Dataset, start_m: float | Array, reach_m: Array) -> bool:
    """Whether the trials that show where the tool touches first have the sheet begin at one place.

    Sheets clamped anew begin elsewhere in every trial. The force is seen to rise some part of the way in
    `reach_m` [R] before or after `start_m`: which part is the same in all trials, and does not matter.
    """
    away = (touches_m(dataset) - start_m) / reach_m
    seen = away[np.isfinite(away)]
    return not seen.size or bool(np.median(np.abs(seen - np.median(seen))) < _AT_ONE_PLACE)


def _ends_of_sheet(rounds: Sequence[SlowRound]) -> SlowCandidate | None:
    """Entry and exit as found beside a first model, where they are the best of their round and about as the
    geometry has them."""
    for each in rounds:
        best = each.candidates[0]
        if best.kind.name == NAME:
            clear = best.decision.gain > 2.0 * best.decision.gain_standard_error
            return best if clear and like_geometry(best.effect) else None
    return None


def _zeroed_in_air(dataset: Dataset, before_m: Array) -> Dataset:
    """The trials less what each shows before it comes to `before_m` [R], where all show enough of that.

    A sensor zeroed before every trial leaves a bias in each that a fit can hardly tell from the force of a
    tool that is always engaged; in the air it is there to be read.
    """
    if dataset.sensor.zeroed != "trial":
        return dataset
    trials, cuts = [], 0
    for trial in dataset.trials:
        if trial.kind == "cut":
            air = along_path(trial) < before_m[cuts]
            if air.sum() < _FEWEST_IN_AIR:
                return dataset
            trial = replace(trial, force_n=trial.force_n - trial.force_n[air].mean(axis=0))
            cuts += 1
        else:
            trial = replace(trial, force_n=trial.force_n - trial.force_n.mean(axis=0))
        trials.append(trial)
    return replace(dataset, trials=tuple(trials), sensor=replace(dataset.sensor, zeroed="session"))


def _engaged(dataset: Dataset, lines: Lines, ends: Ends, reach_m: Array) -> tuple[Dataset, list[int]]:
    """The trials cut down to where the tool is fully in the sheet, without those of which too little is left;
    and which of the cut trials remain.

    Arguments:
        ends: (start, end) of the sheet along the path, m, and whether the axis meets them.
        reach_m: [R] way from the first touch until the tool is fully engaged, m.
    """
    cuts = [trial for trial in dataset.trials if trial.kind == "cut"]
    parts = {}
    for trial, way_m in zip(cuts, reach_m, strict=True):
        place = felt_at(trial, filter_delay_s(dataset.sensor))
        rim_m = place + ends[2] * way_m
        inside = np.flatnonzero((rim_m >= ends[0] + way_m) & (rim_m <= ends[1]))
        part = slice(int(inside[0]), int(inside[-1]) + 1) if inside.size else slice(0, 0)
        parts[trial.file] = place, part
    rest = cut_down(dataset, parts, _SAMPLES_PER_LINE * float(lines.present.sum(axis=1).max()))
    left = {trial.file for trial in rest.trials}
    return rest, [index for index, trial in enumerate(cuts) if trial.file in left]


def _judged_whole(
    dataset: Dataset, inside: Pass, first: SlowCandidate, ends: Ends, tries: int
) -> tuple[SlowRound, Told]:
    """Entry and exit on the whole records, beside a model traced inside the sheet.

    Arguments:
        dataset: the whole trials.
        inside: what was found on them cut down.
        first: what was found on the whole records, with its places and their intervals; `ends` they are
            about, and how they are met.
        tries: effects tried along a trial.
    """
    kind, final, weight = effect_class(NAME), inside.final, np.asarray(inside.search.problem.weight)
    outside = outside_the_cut(dataset, inside)
    shape = np.array(ends)
    for closer in _CLOSER:
        step = closer * _STEP * outside[0].ramps.longest_m
        shape = closest(outside, _around(shape, step), weight)
    told = held_against([each.missing(shape) for each in outside], outside, final, weight)
    effect = effect_at(shape, np.array([told.share]))
    parameters = {"share": interval(kind, "share", told.share, told.by_fold)}
    for name in ("start_m", "length_m"):
        old, new = first.decision.parameters[name], float(effect.values()[name])
        parameters[name] = replace(
            old, value=new, low=new - old.value + old.low, high=new - old.value + old.high
        )
    way = first.decision.parameters["by_axis"]
    parameters["by_axis"] = replace(way, value=ends[2], low=ends[2], high=ends[2])
    return told.round(effect, parameters, inside.after, tries), told


def _around(shape: Array, step: float) -> list[Array]:
    """The ends moved together or apart by up to four steps; an end that is not there stays away."""
    moves = step * np.arange(-4, 5)
    starts = shape[0] + moves if np.isfinite(shape[0]) else shape[:1]
    ends = shape[1] + moves if np.isfinite(shape[1]) else shape[1:2]
    return [np.array([a, b, shape[2]]) for a in starts for b in ends]
