"""Forward search: which registered effects, added one after another, lower the error on trials not seen.

Each round looks at every candidate beside what is accepted already (`screening`), fits the most telling ones
fully, scores them on held-out trials, tests them (`decision`), accepts the best that passes, and looks again
at what remains, as long as enough does. The best of the others is the runner-up. In the end each effect must
still earn its place (`exchange`). Whether the teeth go on circles or on their true path is asked before the
first round and with each effect about to be accepted; a round in which that turns is held again.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.fitting.fit import Effects, Fit, fit_base, reweighted
from mjx_cutting.tracing.fitting.heldout import HeldOut, held_out, in_lines_n2
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.fitting.screening import Screened, screen
from mjx_cutting.tracing.fitting.tooth_path import on_other_path, on_true_path
from mjx_cutting.tracing.naming.bends import fewest
from mjx_cutting.tracing.naming.candidate import Candidate, Contest, Round, fitted, parameters, try_effect
from mjx_cutting.tracing.naming.exchange import reconsider
from mjx_cutting.tracing.naming.finer import finer
from mjx_cutting.tracing.naming.intervals import Interval
from mjx_cutting.tracing.naming.onset import with_onset
from mjx_cutting.tracing.naming.together import two_at_once
from mjx_cutting.tracing.records.lines import Lines

MOST_EFFECTS = 4
SHORTLIST = 4
_WORTH_A_FIT = 0.01
_MUCH_MORE = 1.25
Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Search:
    """What the search found.

    Fields:
        problem: the problem, weighted for the final model.
        base_fit, base: base model and its held-out error.
        effects, final_fit, final: accepted effects, the final model and its held-out error.
        rounds: every round, in order.
        intervals: parameters of the final model with their intervals, effect by effect.
    """

    problem: Problem
    base_fit: Fit
    base: HeldOut
    effects: Effects
    final_fit: Fit
    final: HeldOut
    rounds: tuple[Round, ...] = ()
    intervals: tuple[dict[str, Interval], ...] = ()


def search(
    problem: Problem,
    lines: Lines,
    candidates: Sequence[type[AbstractEffect]],
    fold: NDArray[np.int64],
    progress: Progress = lambda text: None,
) -> Search:
    """Run the search; `progress` is told what is being tried."""
    progress("base model")
    problem, base = fit_base(problem)
    if (other := on_other_path(problem, (), base.x)) is not None:
        problem, base = fit_base(other)
    candidates = with_onset(problem, candidates)
    base_heldout = held_out(problem, lines, (), base.x, fold)
    effects: Effects = ()
    current, heldout = base, base_heldout
    rounds: list[Round] = []
    moved, seen = False, frozenset[str]()
    while len(effects) < MOST_EFFECTS and (not rounds or _worth_a_round(problem, lines, heldout)):
        open_ = [
            kind
            for kind in candidates
            if sum(kind.name == each.name for each in effects) < kind.most and kind.size(problem.tool) > 0
        ]
        screened = screen(problem, effects, current.x, open_, progress)
        contest, tried = Contest(problem, lines, fold, open_), []
        for each in shortlist(screened, seen):
            progress(" + ".join([*(kind.name for kind in effects), each.kind.name]))
            both = (*effects, each.kind)
            one = try_effect(contest, both, each.x, current, heldout)
            tried.append(finer(one, contest, both, current, heldout))
        tried.sort(key=lambda each: each.heldout.nrmse)
        accepted = _accepted(tried)
        accepted = accepted and fewest(contest, effects, accepted, tried)
        found: tuple[Round, ...] = (Round(heldout, screened, tuple(tried), accepted),)
        if accepted is None and len(effects) + 1 < MOST_EFFECTS:
            progress("two effects at once")
            found = two_at_once(contest, effects, current, found[0]) or found
        rounds += found
        if (last := found[-1].accepted) is None:
            break
        more = (*effects, *(each.accepted.kind for each in found if each.accepted is not None))
        problem = reweighted(problem, last.fit)
        if not moved and (other := on_other_path(problem, more, last.fit.x)) is not None:
            progress("once more, the teeth on " + ("their true path" if on_true_path(other) else "circles"))
            moved, problem, rounds = True, other, rounds[: -len(found)]
            seen = frozenset(each.accepted.kind.name for each in found if each.accepted is not None)
            base, base_heldout = fitted(problem, lines, (), np.asarray(base.x), fold)
            current, heldout = fitted(problem, lines, effects, np.asarray(current.x), fold)
            problem = reweighted(problem, current)
            continue
        effects = more
        current, heldout = fitted(problem, lines, effects, np.asarray(last.fit.x), fold)
    for _ in effects[1:]:
        progress("second thoughts about " + ", ".join(kind.name for kind in effects[:-1]))
        change, rounds = reconsider(problem, lines, effects, current.x, rounds, fold)
        if change is None:
            break
        effects = change.effects
        rounds[change.place] = change.round
        current, heldout = fitted(problem, lines, effects, change.x, fold)
    intervals = parameters(problem, lines, effects, current, heldout) if effects else []
    return Search(problem, base, base_heldout, effects, current, heldout, tuple(rounds), tuple(intervals))


def _accepted(tried: Sequence[Candidate]) -> Candidate | None:
    """The best of `tried` that passes; none where one explains much more that fails only because its gain
    differs from trial to trial: then the lesser one is not the cause."""
    accepted = next((each for each in tried if each.decision.accepted), None)
    if accepted is None:
        return None
    unsure = (each.decision.gain for each in tried if each.decision.scattered)
    return accepted if max(unsure, default=0.0) < _MUCH_MORE * accepted.decision.gain else None


def _worth_a_round(problem: Problem, lines: Lines, heldout: HeldOut) -> bool:
    """Whether an effect more could account for as much of the force as one must (`decision`): none takes away
    what lies between the lines."""
    assert heldout.fits is not None
    left_n2 = in_lines_n2(heldout.fits, heldout.fold[lines.owner])
    return bool(left_n2.sum() >= problem.tolerance**2 * heldout.energy_n2.sum())


def shortlist(screened: Sequence[Screened], seen: Collection[str] = ()) -> list[Screened]:
    """Those worth a full fit: the most telling few, and beyond the first two only what explains something;
    and those by whose names the search was here before."""
    telling = [
        each for rank, each in enumerate(screened[:SHORTLIST]) if rank < 2 or each.share > _WORTH_A_FIT
    ]
    return telling + [each for each in screened if each.kind.name in seen and each not in telling]
