"""Is a named effect more than a factor that every trial could have of its own?

Whatever makes all the force of a trial larger or smaller (a material that softens with cutting speed, one
batch beside another) is imitated in part by every effect that grows with something the trials differ in. So
each candidate is held against an unnamed one, a factor a trial: where that explains much more, and leaves of
the candidate little that is its own, the candidate is not the cause. No two cuts are quite alike: what
factors do beside a candidate is such scatter, if it is small, if factors that go with nothing would not
follow the candidate so closely by chance, and if the candidate does not bring a shape that is not there:
beside the factors the true one leaves no more than before. Runout, a mode, a filter change the shape of the
force and pass beside any factor, or explain what the factors leave; a mode or a filter that does neither,
however much it explains, is but a gain at each spindle speed. And one that does little beside the factors
must take most of what is missing: gains that go their own way are imitated in part. Levels have no shape, so
tools that have only those are let be.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import Effects
from mjx_cutting.tracing.fitting.model_error import tolerated
from mjx_cutting.tracing.fitting.on_lines import noise_squares
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.guards.gain import Gain
from mjx_cutting.tracing.records.levels import LEVEL_KINDS

_SHARE_OF_FREE = 0.9
_SCATTER = 0.015
_OWN = 0.5
_OWN_OF_A_RESPONSE = 0.2
_SPOILT = 0.1
_MOST = 0.7

SURELY = 1e-4
"""Chance below which factors that go with nothing do not follow an effect."""


def by_chance(share: float, size: int, trials: int) -> float:
    """Chance that an effect of `size` unknowns explains this share of factors that go with nothing."""
    free = trials - 1 - size
    if free < 1 or share >= 1.0:
        return 1.0 if free < 1 else 0.0
    return float(stats.f.sf((share / size) / ((1.0 - share) / free), size, free))


def rather_a_factor(gain: Gain) -> str | None:
    """Why an effect is refused that a factor of each trial's own does better than; None where it is not."""
    problem, lines = gain.problem, gain.lines
    if problem.tool.kind in LEVEL_KINDS:
        return None
    plain, free, _ = _squares(problem, gain.others, np.asarray(gain.before.x))
    plain_with, free_with, force = _squares(problem, gain.effects, np.asarray(gain.found.x))
    explained, unnamed, own = plain - plain_with, plain - free, free - free_with
    if own >= _OWN * explained:
        return None
    ratio = unnamed / max(explained, 1e-300)
    scatter = plain_with - free_with < _SCATTER**2 * force and own > -_SPOILT * explained
    followed = scatter and by_chance(1.0 / ratio, gain.kind.size(problem.tool), problem.trials) < SURELY
    if ratio > 1.0 / _SHARE_OF_FREE and not followed:
        return f"a factor of its own for each trial explains {ratio:.1f} times as much"
    quiet = float(noise_squares(problem, lines).sum())
    missing, rest = plain - quiet, free - quiet
    if rest > tolerated(problem, lines) ** 2 and own >= _MOST * rest:
        return None
    if gain.kind.transfer is not AbstractEffect.transfer and own < _OWN_OF_A_RESPONSE * explained:
        return (
            "does no more than a factor of its own for each trial would: the spindle's speeds alone tell it"
        )
    if explained < _MOST * missing:
        return f"explains {explained / missing:.0%} of what is missing, little of it beside a factor a trial"
    return None


def _squares(problem: Problem, effects: Effects, x: NDArray[np.floating]) -> tuple[float, float, float]:
    """Sum of squares of the weighted residual, and the same with a factor on the force of each trial; that of
    the force itself."""
    rows = Descent(problem, effects).rows(x[None])
    descent = Descent(problem, effects, rows.phase_rad[0])
    shape = problem.whitened.shape
    left = rows.left[0, : descent.measured].reshape(shape)
    mark = descent.mark(x[None]).reshape(shape)
    if np.any(np.asarray(problem.bias_spread_n) > 0.0):
        # a bias of each trial's own has taken the mean out of what is left
        constant = np.asarray(problem.factor)[:, 0]
        constant = constant / np.linalg.norm(constant, axis=1, keepdims=True)
        mark = mark - np.einsum("rp,rq,rqa->rpa", constant, constant, mark)
    left, mark = (each.reshape(problem.trials, -1) for each in (left, mark))
    size = np.maximum(np.sum(mark**2, axis=1), 1e-300)
    plain = np.sum(left**2, axis=1)
    free = plain - np.sum(left * mark, axis=1) ** 2 / size
    return float(plain.sum()), float(free.sum()), float(size.sum())
