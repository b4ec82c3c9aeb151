"""Entry and exit, seen where records have too much air for a model of the whole.

Records that hold more air than cut tell a steady model nothing, and no effect is found beside such a one.
Traced where the tool is in the cut (`along/engaged`), the force missing along the ramps is held against the
geometry. They may all show the sheet to begin at one place, met by the rim or by the axis; where the tool
leaves is then taken as each record has it. Where each record has a place of its own (sheets clamped anew, a
recorder started by hand), that is found on it, as its phase is, and what is repeatable is the way in and out:
positions then count from the first touch, or, where a place of the sheet counts from its edge, from where the
axis meets that. A tool that is lowered into the sheet is all in at once: the geometry must leave less than
half of what that leaves, and hardly any of what is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing.along.ends import NAME, effect_at, like_geometry
from mjx_cutting.tracing.along.engaged import Engaged, cut_down, one_place
from mjx_cutting.tracing.naming.intervals import Interval, interval
from mjx_cutting.tracing.passes import Pass
from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.tracing.whole_records import (
    Outside,
    closest,
    held_against,
    left_of,
    met,
    outside_the_cut,
    with_ends,
)
from mjx_cutting.trials.dataset import Dataset

_BEFORE, _BEHIND = 1.5, 0.3
_STEPS = 25
_CLOSER = (1.0, 0.1, 0.01)
_FEWEST = 3
_RAMP_LEFT = 0.05
_OF_AT_ONCE = 0.5
_LEFT_OF_IT = 0.005
Array = NDArray[np.floating]


def entered(whole: Pass, inside: Pass, part: Engaged, one_pass: Callable[[Dataset], Pass]) -> Pass:
    """The pass `inside` the cut, with entry and exit named where the whole records have them by geometry.

    Arguments:
        whole: what was found on the whole records; `inside` on the trials cut down, `part`.
        one_pass: traces trials; called where some of those begin while the tool is still finding the sheet.
    """
    weight = np.asarray(inside.search.problem.weight)
    outside = outside_the_cut(part.whole, inside)
    files = [trial.file for trial in inside.dataset.trials if trial.kind == "cut"]
    touched = [part.touched_m.get(file, (-np.inf, np.inf)) for file in files]
    ends = np.array([_ends(each, *own, weight) for each, own in zip(outside, touched, strict=True)])
    reach = np.array([each.reach_m for each in outside])
    found = None if part.from_the_edge else _one_place(ends[:, 0], reach)
    if found is not None:
        start, by_axis = found
        ends[:, 0] = start.value - by_axis * reach
    elif _by_geometry(outside, ends, touched, weight, inside.lines.noise_std_n()):
        start, by_axis = Interval(0.0, 0.0, 0.0, "m"), float(part.from_the_edge)
    else:
        return inside
    full_m = dict(zip(files, (ends[:, 0] + reach).tolist(), strict=True))
    full = _fully_in(inside.dataset, full_m, _RAMP_LEFT * float(reach.min()))
    if full is not None:
        return entered(whole, one_pass(full), part, one_pass)
    missing = [each.missing(np.append(own, 0.0)) for each, own in zip(outside, ends, strict=True)]
    told = held_against(missing, outside, inside.final, weight)
    effect = effect_at(np.array([start.value, np.inf, by_axis]), np.array([told.share]))
    if not like_geometry(effect):
        return inside
    parameters = {"share": interval(effect_class(NAME), "share", told.share, told.by_fold), "start_m": start}
    for name in ("length_m", "by_axis"):
        value = float(effect.values()[name])
        parameters[name] = Interval(value, value, value, effect_class(NAME).parameters[name].unit)
    tried = max((len(each.candidates) for each in whole.slow), default=1)
    named = told.round(effect, parameters, inside.after, tried + 1)
    if named.accepted is None:
        return inside
    sentence = "everything else was traced where the tool is fully in the sheet"
    if found is None:
        counted = "where the tool's axis meets the edge" if part.from_the_edge else "the first touch"
        sentence += (
            "; where that begins and ends is each record's own and was found on it, so that positions "
            f"count from {counted}"
        )
    else:
        sentence += f", which {met(start.value, by_axis)} in every trial"
    place = [trial.file for trial in whole.dataset.trials if trial.kind == "cut"]
    base_n2 = whole.search.base.error_n2[[place.index(file) for file in files]]
    return with_ends(inside, named, told, sentence, base_n2)


def _by_geometry(
    outside: Sequence[Outside],
    ends: Array,
    touched: Sequence[tuple[float, float]],
    weight: Array,
    noise_n: Array,
) -> bool:
    """Whether most records show the tool come in or go out, and do so by the geometry of these `ends` [R, 2]:
    far rather than at once, and with hardly more left of what is missing than noise of `noise_n` [3]."""
    shown = np.isfinite(ends).any(axis=1)
    if shown.sum() < max(_FEWEST, len(outside) / 2):
        return False
    left, missing, noise = np.zeros(2), 0.0, 0.0
    for record, own, near in zip(outside, ends, touched, strict=True):
        at_once = _ends(record, *near, weight, at_once=True)
        left += (
            left_of([record], np.append(own, 0.0), weight),
            left_of([record], np.append(at_once, 0.0), weight, True),
        )
        missing += float(np.sum((record.missing(np.append(own, 0.0)) * weight) ** 2))
        noise += float(record.where.sum() * np.sum((noise_n * weight) ** 2))
    return bool(left[0] < _OF_AT_ONCE * left[1] and left[0] - noise < _LEFT_OF_IT * missing)


def _fully_in(dataset: Dataset, from_m: dict[str, float], allowed_m: float) -> Dataset | None:
    """The trials from where along the path, by file, the tool is fully in the sheet; None where all but begin
    there, or too few would be left."""
    cuts = [trial for trial in dataset.trials if trial.kind == "cut"]
    late_m = [from_m[trial.file] - along_path(trial)[0] for trial in cuts]
    if max(late_m) <= allowed_m:
        return None
    parts = {}
    for trial in cuts:
        place = along_path(trial)
        parts[trial.file] = place, slice(int(np.searchsorted(place, from_m[trial.file])), len(place))
    rest = cut_down(dataset, parts)
    return None if sum(trial.kind == "cut" for trial in rest.trials) < _FEWEST else rest


def _ends(
    record: Outside, first_m: float, last_m: float, weight: Array, at_once: bool = False
) -> tuple[float, float]:
    """Where the rim meets the sheet's begin and end in one record, m, near where its force does; infinite at
    an end that the record does not reach."""
    found = np.array([first_m, last_m, 0.0])
    for closer in _CLOSER:
        low, high = (-_BEFORE, _BEHIND) if closer == 1.0 else (-1.0, 1.0)
        for side in (0, 1):
            if np.isfinite(found[side]):
                tried = np.tile(found, (_STEPS, 1))
                tried[:, side] += closer * record.reach_m * np.linspace(low, high, _STEPS)
                found = closest([record], tried, weight, at_once)
    return float(found[0]), float(found[1])


def _one_place(rim_m: Array, reach_m: Array) -> tuple[Interval, float] | None:
    """Where all records that show it have the sheet begin, m, and whether the axis meets it there, 1, or the
    rim, 0; None where they differ, or too few show it."""
    shown = np.isfinite(rim_m)
    if shown.sum() < _FEWEST or (found := one_place(rim_m[shown], reach_m[shown])) is None:
        return None
    places, by_axis = found
    return Interval(float(np.median(places)), float(places.min()), float(places.max()), "m"), by_axis
