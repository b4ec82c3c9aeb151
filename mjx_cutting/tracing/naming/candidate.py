"""One effect tried beside others: its full fit, its error on held-out trials, the tests it must pass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import Effects, Fit, freedom
from mjx_cutting.tracing.fitting.heldout import HeldOut, held_out
from mjx_cutting.tracing.fitting.model_error import model_errors, tolerated
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.fitting.screening import Screened
from mjx_cutting.tracing.guards.asked import refusal
from mjx_cutting.tracing.guards.gain import Gain
from mjx_cutting.tracing.naming.chance import chance
from mjx_cutting.tracing.naming.decision import Decision, decide
from mjx_cutting.tracing.naming.in_every_trial import in_every_trial
from mjx_cutting.tracing.naming.intervals import Interval, interval
from mjx_cutting.tracing.naming.one_bend import one_bend
from mjx_cutting.tracing.naming.seen_in_air import seen_in_air
from mjx_cutting.tracing.records.levels import LEVEL_KINDS, axes_of
from mjx_cutting.tracing.records.lines import Lines

_STEPS = 20


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect tried beside those accepted: its fit, its error on held-out trials, the decision, and how
    many combinations of all unknowns the trials tell with it."""

    kind: type[AbstractEffect]
    fit: Fit
    heldout: HeldOut
    decision: Decision
    told: int


@dataclass(frozen=True, eq=False)
class Round:
    """One round of the search.

    Fields:
        before: held-out error of the model so far.
        screened: every candidate after its short fit, the most telling first.
        candidates: those fitted fully, in order of held-out error.
        accepted: the one accepted, if any.
        again: the round held once more beside what was accepted later, the best alternatives alone.
    """

    before: HeldOut
    screened: tuple[Screened, ...]
    candidates: tuple[Candidate, ...]
    accepted: Candidate | None
    again: Round | None = None

    @property
    def runner_up(self) -> Candidate | None:
        """The best candidate that was not accepted; one that needs an unphysical value only if all do."""
        others = [each for each in self.candidates if each is not self.accepted]
        return next((each for each in others if each.decision.physical), others[0] if others else None)


@dataclass(frozen=True, eq=False)
class Contest:
    """What the effects tried for one place have in common.

    Fields: `problem`, `lines`: the trials; `fold` [R] fold of each; `looked_for` all that were tried in that
    place, for the chance of the best of them.
    """

    problem: Problem
    lines: Lines
    fold: NDArray[np.int64]
    looked_for: Sequence[type[AbstractEffect]]

    @property
    def tries(self) -> int:
        """Number of starts of all of them."""
        return sum(len(each.starts(self.problem.tool)) for each in self.looked_for)


def try_effect(
    contest: Contest, effects: Effects, start: NDArray[np.floating], before: Fit, before_heldout: HeldOut
) -> Candidate:
    """Fit and judge the last of `effects` beside the others.

    Arguments:
        effects: the model's; `start` [U] unknowns to start from.
        before, before_heldout: fit and held-out error without the last effect.
    """
    found = fitted(contest.problem, contest.lines, effects, start, contest.fold)
    return judged(contest, effects, *found, before, before_heldout)


def judged(
    contest: Contest, effects: Effects, found: Fit, after: HeldOut, before: Fit, before_heldout: HeldOut
) -> Candidate:
    """The last of `effects` judged by its fit `found`, and the held-out error `after` it; the rest as of
    `try_effect`."""
    kind, problem, lines = effects[-1], contest.problem, contest.lines
    p = beyond_chance(problem, lines, effects[:-1], before, effects, found, contest.tries)
    own = parameters(problem, lines, effects, found, after)[-1]
    tolerance, axes = problem.tolerance, axes_of(problem.tool.kind)
    in_air = seen_in_air(problem, before, found, kind.size(problem.tool), contest.tries)
    decision = decide(kind, before_heldout, after, p, own, not in_air, tolerance, axes=axes)
    if decision.scattered and in_every_trial(
        problem, lines, effects, before_heldout, after, contest.tries, p
    ):
        decision = decide(kind, before_heldout, after, p, own, False, tolerance, axes=axes)
    if decision.accepted and (why := refusal(Gain(problem, lines, effects, before, found))) is not None:
        decision = replace(decision, accepted=False, reasons=(why,), guarded=True)
    if decision.accepted and (why := one_bend(problem, kind)) is not None:
        decision = replace(decision, accepted=False, reasons=(why,), untold=True)
    told = Descent(problem, effects).told(np.asarray(found.x))
    return Candidate(kind, found, after, decision, told)


def beyond_chance(
    problem: Problem, lines: Lines, fewer: Effects, before: Fit, more: Effects, after: Fit, tries: int
) -> float:
    """Probability that chance lowers the squared error as much as from the fit `before` of the effects
    `fewer` to that `after` of `more`, at the best of `tries`.

    Levels of one trial that rise and fall together say one thing, not three: of them, and of the unknowns
    that they tell, where more is left than the model may be off, as many are counted as that has independent
    directions.
    """
    descent = Descent(problem, more)
    told_before = Descent(problem, fewer).told(np.asarray(before.x))
    told = descent.told(np.asarray(after.x))
    left = freedom(problem, after, told)
    if problem.tool.kind in LEVEL_KINDS and after.squares > tolerated(problem, lines) ** 2:
        left = max(int(left * _independent(descent, after.x)), 1)
    return chance(
        drop=float(before.squares - after.squares),
        added=max(told - told_before, 1),
        spread=float(np.sqrt(after.squares / left)),
        floor=tolerated(problem, lines) / np.sqrt(left),
        freedom=left,
        tries=tries,
    )


def _independent(descent: Descent, x: ArrayLike) -> float:
    """Independent directions of what the channels leave over the trials, as a share of the channels: by the
    participation ratio of its covariance. Channels in which nothing is left at all do not count."""
    left = descent.rows(np.asarray(x)[None]).left[0, : descent.measured].reshape(-1, 3)
    size = np.linalg.svd(left[:, np.any(left != 0.0, axis=0)], compute_uv=False) ** 2
    return float(size.sum() ** 2 / max(np.sum(size**2), 1e-300) / max(len(size), 1))


def fitted(
    problem: Problem, lines: Lines, effects: Effects, start: NDArray[np.floating], fold: NDArray[np.int64]
) -> tuple[Fit, HeldOut]:
    """Fit of a model to all trials from the unknowns `start` [U], and its error on held-out trials."""
    descent = Descent(problem, effects)
    x, _ = descent.descend(start, _STEPS)
    found: Fit = jax.tree.map(lambda leaf: leaf[0], descent.fits(x[None], np.ones((1, problem.trials))))
    return found, held_out(problem, lines, effects, x, fold)


def parameters(
    problem: Problem, lines: Lines, effects: Effects, found: Fit, heldout: HeldOut
) -> list[dict[str, Interval]]:
    """Parameters of every effect with their intervals, by name, in the order of `effects`."""
    assert heldout.fits is not None
    errors = model_errors(problem, lines, effects, found.x)
    # a model's last effects may be given, not looked for
    fitted = zip(effects, found.model.effects, heldout.fits.model.effects, errors, strict=False)
    return [
        {
            name: _read(kind, name, getattr(whole, name))
            if name in kind.held
            else interval(
                kind,
                name,
                getattr(whole, name),
                getattr(by_fold, name),
                model_error=moved.by_name[name],
                scale=moved.scale if name == kind.strength else None,
            )
            for name in kind.parameters
        }
        for kind, whole, by_fold, moved in fitted
    ]


def _read(kind: type[AbstractEffect], name: str, value: ArrayLike) -> Interval:
    """A parameter that was read from the trials, with what they leave open."""
    return Interval(float(np.asarray(value)), *kind.held[name], kind.parameters[name].unit)
