"""Two effects at once, where neither stands out alone.

What one effect leaves unexplained of another's work is scatter to a test of it alone: few trials, of which a
size effect and a drift each take half of what is missing, name neither. So where no candidate passes and much
is missing, the two that explain most together are tried, unless noise and what any model may be off are far
more than they may leave: pairs are fitted for two steps, the best of them further, from what each is alone
and, where none does, from where the search for it begins. They are named where together they leave little of
it, beyond what the best of all pairs does by chance, and each passes every test beside the other. Beside the
other each is told as finely as the trials show it: wear in its stages.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import Effects, Fit
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.model_error import tolerated
from mjx_cutting.tracing.fitting.on_lines import noise_squares
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.fitting.screening import Screened
from mjx_cutting.tracing.naming.bends import fewest, of_chip
from mjx_cutting.tracing.naming.candidate import Candidate, Contest, Round, beyond_chance, try_effect
from mjx_cutting.tracing.naming.chance import CHANCE
from mjx_cutting.tracing.naming.finer import finer
from mjx_cutting.tracing.records.levels import LEVEL_KINDS

_STEPS = (2, 6)
_GO_ON, _GO_ON_AFRESH = 4, 12
_FEW = 2
_FOLLOW, _SOMETHING = 4, 0.01
_LEFT = 0.35
_FAR_MORE = 2.0
_EACH = 0.8
Alone = Candidate | Screened
Pair = tuple[Alone, Alone]
Begun = tuple[Pair, NDArray[np.floating]]


def two_at_once(contest: Contest, effects: Effects, before: Fit, alone: Round) -> tuple[Round, Round] | None:
    """The round in which no candidate passed as two, in which a pair of them did; None where none does.

    Arguments:
        effects: accepted so far; `before` the fit with them.
        alone: the round, with every candidate as it does alone.
    """
    problem = contest.problem
    pairs = list(combinations(alone.candidates, 2))
    unexplained = float(noise_squares(problem, contest.lines).sum()) + tolerated(problem, contest.lines) ** 2
    if not pairs or unexplained > _FAR_MORE * _LEFT**2 * float(before.squares):
        return None
    most = _LEFT**2 * float(before.squares)
    begins: list[Begun] = [(pair, _together(problem, pair)) for pair in pairs]
    found, x, squares = _best(problem, effects, begins, _GO_ON)
    if not squares < most:
        # what an effect is alone may be far from what it is beside another
        more: list[Pair] = [*pairs, *product(alone.candidates, _following(problem, alone))]
        begins = [(both, x) for both in more for x in _afresh(problem, before, both)]
        if not begins:
            return None
        found, x, squares = _best(problem, effects, begins, _GO_ON_AFRESH)
    if not squares < most:
        return None
    found, x = _of_fewest(contest, effects, before, alone, found, x)
    pair = [_tried(contest, effects, before, alone, each) for each in found]
    first, second = sorted(pair, key=lambda each: each.heldout.nrmse)
    own, last = first.kind.size(problem.tool), second.kind.size(problem.tool)
    x = x if pair[1] is second else _exchanged(x, own, last)

    def by_itself(told: Candidate, as_it_was: Candidate, beside: int) -> Candidate:
        """What was found beside `beside` unknowns of another, as it does alone."""
        if told.kind is as_it_was.kind:
            return as_it_was
        x, own = np.asarray(told.fit.x), told.kind.size(problem.tool)
        start = np.concatenate([x[: len(x) - own - beside], x[len(x) - own :]])
        return try_effect(contest, (*effects, told.kind), start, before, alone.before)

    later = _finest(contest, (*effects, first.kind, second.kind), x, first)
    last = later.kind.size(problem.tool)
    x = _exchanged(np.asarray(later.fit.x), last, own)
    earlier = _finest(contest, (*effects, later.kind, first.kind), x, by_itself(later, second, own))
    both = (*effects, earlier.kind, later.kind)
    if earlier.kind is not first.kind:
        x = _exchanged(np.asarray(earlier.fit.x), earlier.kind.size(problem.tool), last)
        alone_so = by_itself(earlier, first, last)
        later = try_effect(contest, both, x, alone_so.fit, alone_so.heldout)
    tries = contest.tries**2
    by_chance = beyond_chance(problem, contest.lines, effects, before, both, later.fit, tries)
    passed = earlier.decision.accepted and later.decision.accepted and by_chance <= CHANCE
    if not (passed and _little_is_left(alone.before, first.heldout, second.heldout, later.heldout)):
        return None
    named = replace(first, kind=earlier.kind, decision=earlier.decision)
    others = (each for each in alone.candidates if each not in pair)
    return (
        replace(alone, accepted=named, candidates=(named, *others)),
        Round(first.heldout, alone.screened, (later,), later),
    )


def _finest(contest: Contest, effects: Effects, x: NDArray[np.floating], other: Candidate) -> Candidate:
    """The last of `effects` tried from the unknowns `x` [U] beside the `other` of the pair alone, with more
    unknowns of its own where they explain more."""
    found = try_effect(contest, effects, x, other.fit, other.heldout)
    return finer(found, contest, effects, other.fit, other.heldout)


def _together(problem: Problem, pair: tuple[Candidate, Candidate]) -> NDArray[np.floating]:
    """[U] unknowns of a pair, each where it is alone."""
    one, other = (np.asarray(each.fit.x) for each in pair)
    return np.concatenate([one, other[-pair[1].kind.size(problem.tool) :]])


def _following(problem: Problem, alone: Round) -> list[Screened]:
    """The most telling of the effects with few starts that explain something, but were not tried alone."""
    tried = [each.kind for each in alone.candidates]
    few = (each for each in alone.screened if len(each.kind.starts(problem.tool)) <= _FEW)
    return [each for each in few if each.share > _SOMETHING and each.kind not in tried][:_FOLLOW]


def _of_fewest(
    contest: Contest, effects: Effects, before: Fit, alone: Round, pair: Pair, x: NDArray[np.floating]
) -> tuple[Pair, NDArray[np.floating]]:
    """The pair and its unknowns [U]; with a law of the chip of fewer unknowns in place of its own where that
    does as well beside the other (`bends`)."""
    tool = contest.problem.tool
    laws = [each for each in pair if of_chip(each.kind)]
    if tool.kind not in LEVEL_KINDS or len(laws) != 1:
        return pair, x
    law, other = laws[0], pair[1] if pair[0] is laws[0] else pair[0]
    if law is pair[0]:
        x = _exchanged(x, other.kind.size(tool), law.kind.size(tool))
    beside, rest = _tried(contest, effects, before, alone, other), x[: len(x) - law.kind.size(tool)]
    ways: list[Alone] = [law]
    others: list[Alone] = [*alone.candidates, *_following(contest.problem, alone)]
    for each in others:
        if of_chip(each.kind) and each.kind.size(tool) < law.kind.size(tool):
            ways.append(each)
    tried = []
    for each in ways:
        at = np.asarray(each.fit.x if isinstance(each, Candidate) else each.x)[-each.kind.size(tool) :]
        start = x if each is law else np.concatenate([rest, at])
        tried.append(
            try_effect(contest, (*effects, other.kind, each.kind), start, beside.fit, beside.heldout)
        )
    best = fewest(contest, (*effects, other.kind), tried[0], tried)
    return (other, ways[tried.index(best)]), np.asarray(best.fit.x)


def _tried(contest: Contest, effects: Effects, before: Fit, alone: Round, each: Alone) -> Candidate:
    """The effect `each` as it does alone."""
    if isinstance(each, Candidate):
        return each
    return try_effect(contest, (*effects, each.kind), each.x, before, alone.before)


def _afresh(problem: Problem, before: Fit, pair: Pair) -> list[NDArray[np.floating]]:
    """[U] unknowns of a pair, each of the two that has few starts at any of those, the other where it is
    alone."""
    starts, few = [], False
    for each in pair:
        own = np.asarray(each.kind.starts(problem.tool))
        few |= len(own) <= _FEW
        at = each.fit.x if isinstance(each, Candidate) else each.x
        starts.append(own if len(own) <= _FEW else np.asarray(at)[None, -own.shape[1] :])
    at = np.asarray(before.x)
    return [np.concatenate([at, one, other]) for one, other in product(*starts)] if few else []


def _best(
    problem: Problem, effects: Effects, begins: Sequence[Begun], go_on: int
) -> tuple[Pair, NDArray[np.floating], float]:
    """The pair that leaves least, of those that `begins` holds with unknowns [U] to start from, the `go_on`
    best of them followed further; its unknowns and sum of squares."""
    begun = [(pair, *_descended(problem, effects, pair, x, _STEPS[0])) for pair, x in begins]
    leading = sorted(begun, key=lambda each: each[2])[:go_on]
    ended = [(pair, *_descended(problem, effects, pair, x, _STEPS[1])) for pair, x, _ in leading]
    return min(ended, key=lambda each: each[2])


def _descended(
    problem: Problem, effects: Effects, pair: Pair, x: NDArray[np.floating], steps: int
) -> tuple[NDArray[np.floating], float]:
    """Unknowns and sum of squares of a short fit of both from `x` [U]."""
    one, other = pair
    return Descent(problem, (*effects, one.kind, other.kind)).descend(x, steps)


def _exchanged(x: NDArray[np.floating], last: int, before: int) -> NDArray[np.floating]:
    """Unknowns [U] with the `last` ones put in front of the `before` ones that stand before them."""
    rest = len(x) - last - before
    return np.concatenate([x[:rest], x[rest + before :], x[rest : rest + before]])


def _little_is_left(nothing: HeldOut, first: HeldOut, second: HeldOut, both: HeldOut) -> bool:
    """Whether a pair leaves little of what is missing, and less by far than either of the two."""
    return both.nrmse < min(_LEFT * nothing.nrmse, _EACH * first.nrmse, _EACH * second.nrmse)
