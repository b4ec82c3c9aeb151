"""Second thoughts: does each effect accepted still earn its place beside those that came after it?

Forward search may name first what does part of two effects' work (a broken tooth for runout and pitch
together) and then add the one that is left. So every effect but the last is taken out again: it must pass the
same tests beside the others, against the best alternatives of its own round. Where an alternative passes and
is better beyond two standard errors, it takes the place; where nothing passes, the place stays empty. Where
it keeps the place, the round is kept as it ends now too: what else is missing scatters over the trials, and
beside it two explanations look alike that are not. What was told with few unknowns while something else
was missing may be told more finely now (`finer`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjx_cutting.tracing.fitting.fit import Effects
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.naming.candidate import Candidate, Contest, Round, fitted, try_effect
from mjx_cutting.tracing.naming.chance import STANDARD_ERRORS, gain_over_trials
from mjx_cutting.tracing.naming.finer import finer
from mjx_cutting.tracing.records.lines import Lines

_ALTERNATIVES = 2


@dataclass(frozen=True, eq=False)
class Change:
    """What second thoughts change. Fields: `place` of the round; `effects` of the model then, `x` [U] its
    unknowns to start from; `round` as it ends now."""

    place: int
    effects: Effects
    x: NDArray[np.floating]
    round: Round


def reconsider(
    problem: Problem,
    lines: Lines,
    effects: Effects,
    x: ArrayLike,
    rounds: Sequence[Round],
    fold: NDArray[np.int64],
) -> tuple[Change | None, list[Round]]:
    """The first change that the trials ask for, None where every effect keeps its place; and the rounds,
    those that were held again with their outcome (`Round.again`).

    Arguments:
        problem, lines: the trials.
        effects: those accepted; `x` [U] unknowns of the model with all of them.
        rounds: of the search, in the order of `effects`, perhaps with one at the end that accepted nothing.
        fold: [R] fold of each trial.
    """
    held = list(rounds)
    here = np.asarray(x)
    sizes = [kind.size(problem.tool) for kind in effects]
    edges = len(here) - sum(sizes) + np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    places = [index for index, each in enumerate(rounds) if each.accepted is not None]
    for index, (kind, place) in enumerate(zip(effects[:-1], places, strict=False)):
        low, high = edges[index], edges[index + 1]
        rest = (*effects[:index], *effects[index + 1 :])
        without = np.delete(here, np.s_[low:high])
        alone, before = fitted(problem, lines, rest, without, fold)
        others = [each for each in rounds[place].candidates if each.kind not in effects][:_ALTERNATIVES]
        # the others alone may have gone far from where they are beside it
        starts = [(kind, [without, here[low:high]])]
        starts += [(each.kind, [np.asarray(alone.x), _coordinates(each, problem)]) for each in others]
        contest = Contest(problem, lines, fold, [each.kind for each in rounds[place].screened])
        tried = [
            try_effect(contest, (*rest, one), np.concatenate(start), alone, before) for one, start in starts
        ]
        tried[0] = finer(tried[0], contest, (*rest, kind), alone, before)
        best = _best(tried)
        ordered = tuple(sorted(tried, key=lambda each: each.heldout.nrmse))
        after = replace(rounds[place], before=before, candidates=ordered, accepted=best, again=None)
        if best is not None and best.kind is kind:
            held[place] = replace(rounds[place], again=after)
            continue
        if best is None:
            return Change(place, rest, np.asarray(alone.x), after), held
        own = _coordinates(best, problem)
        found = np.asarray(best.fit.x)[: -len(own)]
        changed = (*effects[:index], best.kind, *effects[index + 1 :])
        return Change(place, changed, np.insert(found, low, own), after), held
    return None, held


def _best(tried: Sequence[Candidate]) -> Candidate | None:
    """The first of `tried`, unless it fails, or another that passes is better beyond two standard errors."""
    passing = sorted((each for each in tried if each.decision.accepted), key=lambda each: each.heldout.nrmse)
    if not passing or passing[0] is tried[0] or not tried[0].decision.accepted:
        return passing[0] if passing else None
    gain, error = gain_over_trials(tried[0].heldout, passing[0].heldout)
    return passing[0] if gain > STANDARD_ERRORS * error else tried[0]


def _coordinates(candidate: Candidate, problem: Problem) -> NDArray[np.floating]:
    return np.asarray(candidate.fit.x)[-candidate.kind.size(problem.tool) :]
