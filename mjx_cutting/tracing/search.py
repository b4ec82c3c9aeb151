"""Forward search: which registered effects, added one after another, lower the error on trials not seen.

Each round looks at every candidate beside what is accepted already (`screening`), fits the most telling ones
fully, scores them on held-out trials, tests them (`decision`), accepts the best that passes, and looks again
at what remains. The best of the others is the runner-up.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import jax
import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.decision import Decision, Interval, chance, decide, interval
from mjx_cutting.tracing.descent import Descent
from mjx_cutting.tracing.fit import (
    Effects,
    Fit,
    base_starts,
    fit,
    freedom,
    reweighted,
    spread,
)
from mjx_cutting.tracing.heldout import HeldOut, held_out
from mjx_cutting.tracing.lines import Lines
from mjx_cutting.tracing.model_error import model_errors, tolerated
from mjx_cutting.tracing.problem import Problem
from mjx_cutting.tracing.screening import Screened, screen

MOST_EFFECTS = 4
SHORTLIST = 4
_WORTH_A_FIT = 0.01
_STEPS = 20
Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect tried beside those accepted: its fit, its error on held-out trials and the decision."""

    kind: type[AbstractEffect]
    fit: Fit
    heldout: HeldOut
    decision: Decision


@dataclass(frozen=True, eq=False)
class Round:
    """One round of the search.

    Fields:
        before: held-out error of the model so far.
        screened: every candidate after its short fit, the most telling first.
        candidates: those fitted fully, in order of held-out error.
        accepted: the one accepted, if any.
    """

    before: HeldOut
    screened: tuple[Screened, ...]
    candidates: tuple[Candidate, ...]
    accepted: Candidate | None

    @property
    def runner_up(self) -> Candidate | None:
        """The best candidate that was not accepted; one that needs an unphysical value only if all do."""
        others = [each for each in self.candidates if each is not self.accepted]
        return next((each for each in others if each.decision.physical), others[0] if others else None)


@dataclass(frozen=True, eq=False)
class Search:
    """What the search found.

    Fields:
        problem: the problem, weighted for the final model.
        base_fit, base: base model and its held-out error.
        effects, final_fit, final: accepted effects, the final model and its held-out error.
        rounds: every round, in order.
    """

    problem: Problem
    base_fit: Fit
    base: HeldOut
    effects: Effects
    final_fit: Fit
    final: HeldOut
    rounds: tuple[Round, ...] = field(default=())


def search(
    problem: Problem,
    lines: Lines,
    candidates: Sequence[type[AbstractEffect]],
    fold: NDArray[np.int64],
    progress: Progress = lambda text: None,
) -> Search:
    """Run the search; `progress` is told what is being tried."""
    progress("base model")
    base = fit(problem, (), base_starts(problem))
    problem = reweighted(problem, base)
    base = fit(problem, (), np.asarray(base.x)[None])
    base_heldout = held_out(problem, lines, (), base.x, fold)
    effects: Effects = ()
    current, heldout = base, base_heldout
    rounds: list[Round] = []
    while len(effects) < MOST_EFFECTS:
        open_ = [kind for kind in candidates if kind not in effects and kind.size(problem.tool) > 0]
        screened = screen(problem, effects, current.x, open_, progress)
        tried = []
        for each in shortlist(screened):
            progress(" + ".join([*(kind.name for kind in effects), each.kind.name]))
            tried.append(_try(problem, lines, (*effects, each.kind), each.x, current, heldout, fold, open_))
        tried.sort(key=lambda each: each.heldout.nrmse)
        accepted = next((each for each in tried if each.decision.accepted), None)
        rounds.append(Round(heldout, screened, tuple(tried), accepted))
        if accepted is None:
            break
        effects = (*effects, accepted.kind)
        problem = reweighted(problem, accepted.fit)
        current = fit(problem, effects, np.asarray(accepted.fit.x)[None])
        heldout = held_out(problem, lines, effects, current.x, fold)
    return Search(problem, base, base_heldout, effects, current, heldout, tuple(rounds))


def shortlist(screened: Sequence[Screened]) -> list[Screened]:
    """Those worth a full fit: the most telling few, and beyond the first two only what explains something."""
    return [each for rank, each in enumerate(screened[:SHORTLIST]) if rank < 2 or each.share > _WORTH_A_FIT]


def _try(
    problem: Problem,
    lines: Lines,
    effects: Effects,
    start: NDArray[np.floating],
    before: Fit,
    before_heldout: HeldOut,
    fold: NDArray[np.int64],
    tried: Sequence[type[AbstractEffect]],
) -> Candidate:
    """Fit and judge the last of `effects` beside the others."""
    kind = effects[-1]
    descent = Descent(problem, effects)
    x, _ = descent.descend(start, _STEPS)
    found = jax.tree.map(lambda leaf: leaf[0], descent.fits(x[None], np.ones((1, problem.trials))))
    after = held_out(problem, lines, effects, x, fold)
    p = chance(
        drop=float(before.squares - found.squares),
        added=len(found.x) - len(before.x),
        spread=spread(problem, found),
        floor=tolerated(problem, lines) / np.sqrt(freedom(problem, found)),
        freedom=freedom(problem, found),
        tries=sum(len(each.starts(problem.tool)) for each in tried),
    )
    decision = decide(kind, before_heldout, after, p, parameters(problem, lines, effects, found, after)[-1])
    return Candidate(kind, found, after, decision)


def parameters(
    problem: Problem, lines: Lines, effects: Effects, found: Fit, heldout: HeldOut
) -> list[dict[str, Interval]]:
    """Parameters of every effect with their intervals, by name, in the order of `effects`."""
    assert heldout.fits is not None
    errors = model_errors(problem, lines, effects, found.x)
    fitted = zip(effects, found.model.effects, heldout.fits.model.effects, errors, strict=True)
    return [
        {
            name: interval(kind, name, getattr(whole, name), getattr(by_fold, name), model_error=error[name])
            for name in kind.parameters
        }
        for kind, whole, by_fold, error in fitted
    ]
