"""Search over effects that change along a trial, after the steady ones: same tests, same held-out trials."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.along.at_once import fitted_together, with_together
from mjx_cutting.tracing.along.end_layer import rather_a_slope
from mjx_cutting.tracing.along.flutes import of_a_drill
from mjx_cutting.tracing.along.kind import Kind
from mjx_cutting.tracing.along.periodic import PERIODIC
from mjx_cutting.tracing.along.slow_kinds import KINDS, LAYERED, of_each_direction, of_the_chip, that_blend
from mjx_cutting.tracing.along.slow_round import SlowCandidate, SlowRound, less, without
from mjx_cutting.tracing.along.slow_try import (
    IN_POSITION,
    Asked,
    Carrier,
    fall_of_error,
    free_in_position,
    try_one,
    whole_force,
)
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.problem import TOLERANCE
from mjx_cutting.tracing.records.course import Course

MOST_SLOW = 6
_MOST_LAYERS = 3
_MORE = 0.2
_NEARLY = 0.98
_BLENDED = 0.4
_AT_ONE = 0.02
_MUCH_LESS = 0.9
Array = NDArray[np.floating]


def search_slow(
    trials: Sequence[Course],
    before: HeldOut,
    weight: Array,
    names: Sequence[str] | None = None,
    kinds: Sequence[Kind] = KINDS,
    progress: Callable[[str], None] = lambda text: None,
    tolerance: float = TOLERANCE,
    in_range: bool = True,
) -> tuple[SlowRound, ...]:
    """Slow effects accepted one after another, beside a steady model that leaves `before` on held-out trials.

    Layers change all constants alike; or those of the chip alone, or those of each direction by their own,
    whichever force free in position asks for, where much less is left then. Those that are ramps for the most
    part are refused: what changes gradually with the place is no layer.

    Arguments:
        trials: courses of the cut trials.
        before: held-out error of the steady model, with its folds.
        weight: [3] 1 / standard deviation of each axis.
        names: effects to try of `kinds`; default all.
        kinds: how each is looked for.
        tolerance: share of the force that the steady model's own calculation may be off.
        in_range: whether parameters must lie in their physical ranges. A share of the force does not until
            the steady model is freed of what it has taken for its own.
    """

    def search(ways: Sequence[Kind], carrier: Carrier) -> tuple[SlowRound, ...]:
        return _search(trials, before, weight, names, ways, carrier, progress, tolerance, in_range)

    found = _layers_in_the_best_way(search, trials, weight, kinds)
    ramps = _rather_ramps(trials, found)
    if ramps is None:
        return found
    # a wave that was not named beside them does less than they
    named = {each.accepted.kind.name for each in found if each.accepted} - {LAYERED}
    others = tuple(kind for kind in kinds if kind.name in named or kind.name not in (LAYERED, PERIODIC.name))
    first, *later = search(others, whole_force) or [SlowRound(before, (), None)]
    return replace(first, candidates=(*first.candidates, ramps)), *later


def _layers_in_the_best_way(
    search: Callable[[Sequence[Kind], Carrier], tuple[SlowRound, ...]],
    trials: Sequence[Course],
    weight: Array,
    kinds: Sequence[Kind],
) -> tuple[SlowRound, ...]:
    """What a `search` of `kinds`, held to force free in position of a carrier, finds: layers in the way that
    leaves least, be they ramps."""
    found = search(kinds, whole_force)
    if not _like_layers(found):
        return found
    blended = False
    if of_a_drill(trials):
        other = search(that_blend(kinds), whole_force)
        if blended := _left_by(other).nrmse < _MUCH_LESS * _left_by(found).nrmse:
            found = other
    # what is apart in them, how they are then looked for, and what they are held to
    ways: list[tuple[Carrier, Callable[..., tuple[Kind, ...]], Carrier]]
    ways = [(_chip_and_edge, of_the_chip, whole_force)]
    if all(each.by_direction is not None for each in trials):
        ways.append((Course.force_by_direction, of_each_direction, Course.force_by_direction))
    left, error = less(trials, found), _left_by(found)
    falls = [free_in_position(left, error, weight, apart) for apart, _, _ in ways]
    if max(falls) < (1.0 - _MUCH_LESS**2) * float(np.sum(error.error_n2 * weight**2)):
        return found
    _, of_such, free = ways[int(np.argmax(falls))]
    other = search(of_such(kinds, blended), free)
    return other if _left_by(other).nrmse < _MUCH_LESS * error.nrmse else found


def _rather_ramps(trials: Sequence[Course], rounds: Sequence[SlowRound]) -> SlowCandidate | None:
    """The first of the layers found, refused, where they are even over less than most of the way between
    their borders; None where they are, and of drills, whose lips meet a border one place after another."""
    layers = [each.accepted for each in rounds if each.accepted and each.accepted.kind.name == LAYERED]
    if not layers or of_a_drill(trials) or _has_steps(layers):
        return None
    why = (
        f"the borders of its layers are {1e3 * layers[0].shape[2]:.3g} mm wide, more than {_BLENDED:.0%} of "
        "the way between them: force changes gradually with the place, which no layer makes"
    )
    return replace(layers[0], decision=replace(layers[0].decision, accepted=False, reasons=(why,)))


def _chip_and_edge(course: Course) -> Array:
    return np.stack([course.chip_n, course.edge_n], axis=-1)


def _like_layers(rounds: Sequence[SlowRound]) -> bool:
    """Whether layers were accepted, or refused for no more than what they leave of force free in position."""
    return any(
        each.kind.name == LAYERED and (each.decision.accepted or each.short_of_free)
        for one in rounds
        for each in one.candidates
    )


def _left_by(rounds: Sequence[SlowRound]) -> HeldOut:
    """Held-out error beside all that was accepted."""
    last = rounds[-1]
    return last.before if last.accepted is None else last.accepted.heldout


def _search(
    trials: Sequence[Course],
    before: HeldOut,
    weight: Array,
    names: Sequence[str] | None,
    kinds: Sequence[Kind],
    carrier: Carrier,
    progress: Callable[[str], None],
    tolerance: float,
    in_range: bool,
) -> tuple[SlowRound, ...]:
    """`search_slow` with every kind as it is, held to force free in position of the `carrier` [T, 3, k]."""
    open_ = [
        kind
        for kind in kinds
        if (names is None or kind.name in names) and kind.testable(trials) and len(kind.grid(trials))
    ]
    rounds: list[SlowRound] = []
    left = trials
    while open_ and len(rounds) < MOST_SLOW:
        free = free_in_position(left, before, weight, carrier)
        test = Asked(weight, free, len(open_), tolerance, in_range, _by_layers(rounds, weight))
        tried = []
        for kind in open_:
            progress(f"along the trial: {kind.name}")
            tried.append(try_one(kind, left, before, test, _found(rounds, kind)))
        tried.sort(key=lambda each: each.heldout.nrmse)
        accepted = next((each for each in tried if each.decision.accepted), None)
        layers = next((kind for kind in open_ if kind.stack is not None), None)
        least = _least_of_layers(layers, tried, accepted, before, test)
        stack: list[SlowCandidate] = []
        if layers is not None and least is not None:
            stack = _stack(layers, left, before, test, _found(rounds, layers), least)
        if stack:
            others = tuple(each for each in tried if each.kind is not stack[0].kind)
            for each in stack:
                rounds.append(SlowRound(before, (each, *others), each))
                before = each.heldout
        else:
            rounds.append(SlowRound(before, tuple(tried), accepted))
            if accepted is None:
                break
            open_ = [kind for kind in open_ if kind.several or kind.effect is not accepted.kind]
        if layers is not None:
            rounds = _no_slope(with_together(rounds, layers, less(trials, rounds), weight), layers, trials)
            if rounds[-1].accepted is None:
                break
        left = less(trials, rounds)
        before = _left_by(rounds)
    for kind in kinds:
        rounds = with_together(rounds, kind, left, weight)
    return tuple(rounds)


def _by_layers(rounds: Sequence[SlowRound], weight: Array) -> float:
    """Fall of the weighted squared error that layers accepted have brought."""
    found = ((each.before, each.accepted) for each in rounds if each.accepted is not None)
    return sum(fall_of_error(a, b.heldout, weight) for a, b in found if b.kind.name == LAYERED)


def _no_slope(rounds: list[SlowRound], layers: Kind, trials: Sequence[Course]) -> list[SlowRound]:
    """The rounds, the last of them without the only layer found where, its border settled, it is a slope."""
    one = rounds[-1].accepted
    if one is None or one.kind is not layers.effect or len(_found(rounds, layers)) > 1:
        return rounds
    if not (why := rather_a_slope(trials, one.effect)):
        return rounds
    refused = replace(one, decision=replace(one.decision, accepted=False, reasons=(why,)))
    tried = (refused if each is one else each for each in rounds[-1].candidates)
    return [*rounds[:-1], SlowRound(rounds[-1].before, tuple(tried), None)]


def _found(rounds: Sequence[SlowRound], kind: Kind) -> list[Array]:
    """Shapes of what was accepted of a kind that may be there several times; none where each is at a phase of
    its own, and so beside the others."""
    if not kind.several or kind.own_phase:
        return []
    accepted = (each.accepted for each in rounds)
    return [each.shape for each in accepted if each is not None and each.kind is kind.effect]


def _least_of_layers(
    layers: Kind | None,
    tried: Sequence[SlowCandidate],
    accepted: SlowCandidate | None,
    before: HeldOut,
    test: Asked,
) -> float | None:
    """How much several layers together must explain to be named instead of what was accepted: all that force
    free in position does, or half of what it does beyond another effect. None where there is no call to try.
    """
    if layers is None:
        return None
    if accepted is None:
        short = any(each.short_of_free and each.kind is layers.effect for each in tried)
        return test.free if short else None
    if accepted.kind is layers.effect or accepted.kind.name not in IN_POSITION:
        return None
    explained = fall_of_error(before, accepted.heldout, test.weight)
    return 0.5 * (explained + test.free) if explained < test.free else None


def _stack(
    kind: Kind, trials: Sequence[Course], before: HeldOut, test: Asked, beside: list[Array], least: float
) -> list[SlowCandidate]:
    """Several of a kind that together explain `least`, as a sheet of several layers, or nearly that where
    they are even between borders; empty where they do not: steps come near to anything, if not quite."""
    found: list[SlowCandidate] = []
    best: list[SlowCandidate] = []
    rest, error = trials, before
    while len(found) < _MOST_LAYERS:
        # of a further layer no other kind was tried beside it
        asked = replace(test, free=0.0, tries=1 if found else test.tries)
        one = _next_of(kind, rest, error, asked, beside, [each.shape for each in found])
        if one is None:
            break
        found.append(one)
        rest, error = without(rest, one), one.heldout
        closer = fitted_together(kind, found, rest, test.weight)
        explained = fall_of_error(before, closer[-1].heldout, test.weight)
        nearly = _NEARLY if not best and _has_steps(closer) else 1.0
        if explained >= nearly * least:
            best = closer
            least = explained + _MORE * float(np.sum(closer[-1].heldout.error_n2 * test.weight**2))
        if len(found) > 1:
            # of one alone the border would be as wide as all that lies beside it
            found, rest, error = closer, trials, closer[-1].heldout
            for each in found:
                rest = without(rest, each)
    return best


def _has_steps(layers: Sequence[SlowCandidate]) -> bool:
    """Whether layers [start, length, border] are even over most of the way between their borders: broad ones
    are ramps, which come near to any wave."""
    lengths = _between([each.shape for each in layers])[:, 1]
    apart = lengths[lengths > _AT_ONE * lengths.max()]
    return bool(layers[0].shape[2] < _BLENDED * apart.min())


def _next_of(
    kind: Kind,
    rest: Sequence[Course],
    error: HeldOut,
    test: Asked,
    beside: Sequence[Array],
    shapes: Sequence[Array],
) -> SlowCandidate | None:
    """The best further layer beside those at `shapes` [d]; None where none is accepted. Of two that overlap,
    a stretch between their borders may have a force of its own too: two layers have two levels for three."""
    others = [*beside, *shapes]
    free = try_one(kind, rest, error, test, others)
    # which of the stretches is not asked: beside the others one may stand for another, fold by fold
    stretches = _between(shapes) if len(shapes) > 1 else ()
    ways = [replace(kind, grid=partial(_only, each), refine=None) for each in stretches]
    levels = [try_one(way, rest, error, test, others) for way in ways]
    accepted = [each for each in levels if each.decision.accepted]
    level = min(accepted, key=lambda each: each.heldout.nrmse, default=None)
    if level is not None and free.heldout.nrmse > _MUCH_LESS * level.heldout.nrmse:
        return level
    return free if free.decision.accepted else None


def _only(shape: Array, courses: Sequence[Course]) -> Array:
    return shape[None]


def _between(shapes: Sequence[Array]) -> Array:
    """[P, 3] the stretches between neighbouring borders of layers [start, length, border]."""
    borders = np.sort([end for start, length, _ in shapes for end in (start, start + length)])
    return np.array([(a, b - a, shapes[0][2]) for a, b in pairwise(borders)])
