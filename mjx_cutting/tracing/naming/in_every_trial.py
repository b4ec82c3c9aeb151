"""Does what an effect adds go with what was left, in every held-out trial alike?

What an effect takes away may differ much from trial to trial by its own law: an unbalance grows with the
square of the speed. Its gain then scatters over the trials as that of an accident would, which explains one
of them. But an accident in one trial says nothing of the others: what it adds there has no likeness to what
was left. So where most of what was left in the lines of every trial is taken away, and the likeness is the
same in all of them, scatter of the gain is no argument.

Some trials have nothing to gain: the constants went through theirs. So it is also enough that nearly all is
taken away of what was left in all held-out trials, for what happened to one of them alone no fit to the
others foretells, and that the fit is beyond chance by far. Where each trial has lines, not but a level, the
same is asked of what is left in the others without the one that gains most.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import Effects
from mjx_cutting.tracing.fitting.heldout import HeldOut, by_trial
from mjx_cutting.tracing.fitting.on_lines import noise_squares
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.naming.chance import CHANCE, surely
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import Lines

_LEFT = 0.25
_LEFT_OF_ALL = 0.1
_BY_FAR = 1e-4
_FEWEST = 3


def in_every_trial(
    problem: Problem,
    lines: Lines,
    effects: Effects,
    before: HeldOut,
    after: HeldOut,
    tries: int,
    by_chance: float = 0.0,
) -> bool:
    """Whether the last of `effects` takes three quarters of what was left in the lines of each held-out trial
    (squared, beyond the noise, or all but as much as that is), and is like it in each beyond what the best of
    `tries` is by chance; or nine tenths of what was left in all together, of lines also without any one.

    Arguments: `before`, `after` the errors without and with it; `by_chance` probability that chance lowers
        the error of the fit as much.
    """
    old = _left(problem, lines, effects[:-1], before)
    new = _left(problem, lines, effects, after)
    added = old - new

    def of_each(lines_of: NDArray[np.floating]) -> NDArray[np.floating]:
        return by_trial(lines_of.reshape(len(lines_of), -1), lines.owner).sum(axis=1)

    noise, was, left = of_each(noise_squares(problem, lines)), of_each(old**2), of_each(new**2)
    levels = problem.tool.kind in LEVEL_KINDS
    counted = was.sum() - (0.0 if levels else np.max(was - left))
    if by_chance < _BY_FAR and left.sum() < _LEFT_OF_ALL * counted:
        return True
    if levels or len(was) < _FEWEST or np.any(left - noise > np.maximum(_LEFT * (was - noise), noise)):
        return False
    likeness = of_each(old * added) / np.sqrt(np.maximum(was * of_each(added**2), 1e-300))
    return bool(tries * stats.t.sf(surely(likeness), len(was) - 1) < CHANCE)


def _left(problem: Problem, lines: Lines, effects: Effects, heldout: HeldOut) -> NDArray[np.floating]:
    """[R, M] what is left of the lines of every trial, or piece of one, by the fit that did not see it; in
    standard deviations."""
    assert heldout.fits is not None
    descent = Descent(problem, effects)
    left = descent.rows(np.asarray(heldout.fits.x)).left[:, : descent.measured]
    own = heldout.fold[lines.owner]
    return np.asarray(left.reshape(len(left), problem.trials, -1)[own, np.arange(problem.trials)])
