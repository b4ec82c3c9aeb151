"""All that was accepted of one kind, fitted at once: the layers of a sheet, the waves of a periodic one.

What is found first takes what lies beside it for its own, and stands too high or too low by that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.along.kind import Kind, as_values
from mjx_cutting.tracing.along.layers import settled, together
from mjx_cutting.tracing.along.shapes import error_change, solve
from mjx_cutting.tracing.along.slow_round import SlowCandidate, SlowRound
from mjx_cutting.tracing.along.surety import intervals
from mjx_cutting.tracing.naming.intervals import Interval
from mjx_cutting.tracing.records.course import Course

_CLOSER = 0.9
Array = NDArray[np.floating]


def with_together(
    rounds: Sequence[SlowRound], kind: Kind, rest: Sequence[Course], weight: Array
) -> list[SlowRound]:
    """The rounds with all that was accepted of a kind fitted at once; all found leave the `rest`."""
    found = [
        each.accepted for each in rounds if each.accepted is not None and each.accepted.kind is kind.effect
    ]
    if not kind.several or kind.own_phase or not found:
        return list(rounds)
    closer = fitted_together(kind, found, rest, weight)
    anew = dict(zip(map(id, found), closer, strict=True))
    change = closer[-1].heldout.error_n2 - found[-1].heldout.error_n2
    # what was found after them was found beside them as they were
    last = next(i for i, each in enumerate(rounds) if each.accepted is found[-1])
    for later in (each.accepted for each in rounds[last + 1 :] if each.accepted is not None):
        error = np.maximum(later.heldout.error_n2 + change, 0.0)
        anew[id(later)] = replace(later, heldout=replace(later.heldout, error_n2=error))
    return [
        replace(
            each,
            candidates=tuple(anew.get(id(one), one) for one in each.candidates),
            accepted=anew.get(id(each.accepted), each.accepted),
        )
        for each in rounds
    ]


def fitted_together(
    kind: Kind, found: Sequence[SlowCandidate], rest: Sequence[Course], weight: Array
) -> list[SlowCandidate]:
    """All that was accepted of a kind, its strengths fitted at once to what `rest` leaves when all that was
    found is taken out; layers also at places and with borders settled at once, where that leaves less."""
    trials = [
        replace(course, left_n=course.left_n + sum(added))
        for course, *added in zip(rest, *(each.added_n for each in found), strict=True)
    ]
    shapes = [each.shape for each in found]
    in_place = _at(kind, found, shapes, trials, rest, weight) if len(found) > 1 else list(found)
    if kind.stack is None:
        return in_place
    places = settled(kind.stack(trials), shapes, len(trials), weight)
    closer = _at(kind, found, places, trials, rest, weight)
    first, then = (float(np.sum(way[-1].heldout.error_n2 * weight**2)) for way in (in_place, closer))
    return closer if then < _CLOSER * first else in_place


def _at(
    kind: Kind,
    found: Sequence[SlowCandidate],
    shapes: Sequence[Array],
    trials: Sequence[Course],
    rest: Sequence[Course],
    weight: Array,
) -> list[SlowCandidate]:
    """What was `found` of a kind at `shapes` [d], with strengths fitted at once to the `trials`, of which it
    has left the `rest`."""
    found_sums, fold = together(kind, trials, shapes), found[-1].heldout.fold
    _, whole, _ = solve(found_sums, np.ones(len(trials)), weight)
    by_fold = [solve(found_sums, (fold != f).astype(float), weight)[1] for f in range(int(fold.max()) + 1)]
    # held-out errors change as those do on the trials as they are
    change = error_change(found_sums, 0, np.stack([by_fold[f] for f in fold]))
    change -= [np.sum(b.left_n**2 - a.left_n**2, axis=0) for a, b in zip(trials, rest, strict=True)]
    last = found[-1].heldout
    heldout = replace(last, error_n2=np.maximum(last.error_n2 + change, 0.0), fits=None)
    own = len(whole) // len(shapes)
    anew = []
    for i, (each, shape) in enumerate(zip(found, shapes, strict=True)):
        part = slice(own * i, own * (i + 1))
        effect = kind.build(shape, whole[part])
        values = [as_values(kind.build(shape, c[part])) for c in by_fold]
        told = intervals(kind, effect, values, each.unsure)
        by_strength = {name for name in told if len({each[name].tobytes() for each in values}) > 1}
        parameters = {
            name: told[name] if name in by_strength else _centred(interval, told[name].value)
            for name, interval in each.decision.parameters.items()
        }
        columns = [kind.columns(course, shape) for course in trials]
        anew.append(
            replace(
                each,
                effect=effect,
                shape=shape,
                heldout=heldout if i == len(found) - 1 else each.heldout,
                decision=replace(each.decision, parameters=parameters),
                added_n=tuple(c.own(x) @ whole[part] for c, x in zip(trials, columns, strict=True)),
                whole_n=tuple(x @ whole[part] for x in columns),
            )
        )
    return anew


def _centred(interval: Interval, value: float) -> Interval:
    """An interval as wide, about another value."""
    away = value - interval.value
    return replace(interval, value=value, low=interval.low + away, high=interval.high + away)
