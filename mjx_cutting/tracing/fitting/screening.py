"""A first look at every effect of the library: a short fit of each beside the model so far, to choose which
are worth a full one, and what of each the trials could show at all.

Each effect descends a few steps from those starts that a first one brings lowest, then further from the best
(`descent`). A strong resonance on one axis draws the constants far from where they belong, and no descent
finds back; so where most of what is left is on the one axis that an effect changes, it also starts beside
constants fitted to the others. The same numbers give the two figures of an isolability analysis: how much of
an effect's mark on the lines survives refitting what is in the model already (phases and biases with it), and
the cosine between what survives of two effects (Frank and Ding, Automatica 33 (1997) 87-97, for the idea).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import Effects, effect_starts
from mjx_cutting.tracing.fitting.problem import Problem

_FEW = 4
_TRIED = 3
_FIRST_STEPS = 2
_STEPS = 8
_EXPLAINS = 1e-2
_EXPLAINS_MUCH = 0.1
_TRIED_AGAIN = 2
_MOST_OF_IT = 0.5
_NEXT_TO_NONE = 0.02
_IDLE = 1e-9
Matrix = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Screened:
    """One effect after its short fit.

    Fields:
        kind: the effect.
        x: [U] unknowns reached.
        share: part of the squared residual so far that the effect takes away, 0 to 1.
        survival: part of the effect's mark on the lines, at the values reached (or at the start where it
            explains nothing), that refitting the model so far cannot imitate, 0 to 1.
        size: that surviving mark in standard deviations of the residual, at the effect's usual strength.
        direction: [M] the surviving mark as a unit vector; the cosine of two effects is their product.
    """

    kind: type[AbstractEffect]
    x: Matrix
    share: float
    survival: float
    size: float
    direction: Matrix


def screen(
    problem: Problem,
    effects: Effects,
    x: Array,
    kinds: Sequence[type[AbstractEffect]],
    progress: Callable[[str], None] = lambda text: None,
) -> tuple[Screened, ...]:
    """Each of `kinds` beside the model with `effects` at its fitted unknowns `x`, the most telling first."""
    here = np.asarray(x)
    so_far = Descent(problem, effects, Descent(problem, effects).rows(here[None]).phase_rad[0])
    left, slope = so_far.around(here)
    found = []
    for kind in kinds:
        progress(f"screening {kind.name}")
        found.append(_screen(so_far, here, float(left @ left), slope, kind))
    return tuple(sorted(found, key=lambda each: -each.share))


def _screen(
    so_far: Descent, x: Matrix, squares: float, slope: Matrix, kind: type[AbstractEffect]
) -> Screened:
    both = Descent(so_far.problem, (*so_far.effects, kind), so_far.phase_rad)
    span = np.linalg.qr(slope[: so_far.measured])[0]
    starts = _lowest_starts(so_far, both, x, squares, slope)
    tries = sorted((both.descend(start, _FIRST_STEPS) for start in starts), key=lambda each: each[1])
    best, reached = both.descend(tries[0][0], _STEPS)
    if reached < (1.0 - _EXPLAINS_MUCH) * squares:
        best, reached = _again(both, best, reached, slope)
    share = max(0.0, 1.0 - reached / max(squares, 1e-300))
    shown = best if share > _EXPLAINS else starts[0]
    beside, measured = shown[None, : len(x)], so_far.measured
    effect = both.rows(shown[None]).left[0, :measured] - so_far.rows(beside).left[0, :measured]
    surviving = effect - span @ (span.T @ effect)
    size, whole = (
        float(np.linalg.norm(surviving)),
        float(np.linalg.norm(both.mark(shown[None]) - so_far.mark(beside))),
    )
    direction = surviving / max(size, 1e-300)
    return Screened(kind, best, share, min(1.0, size / max(whole, 1e-300)), size, direction)


def _lowest_starts(so_far: Descent, both: Descent, x: Matrix, squares: float, slope: Matrix) -> Matrix:
    """[n, U] the few starts of the last effect of `both`, or of many those a first step brings lowest."""
    kind = both.effects[-1]
    starts = np.asarray(effect_starts(so_far.problem, kind, jnp.asarray(x)))
    if len(starts) <= _FEW:
        return starts
    reached = both.glance(starts, slope)
    # from where it does nothing no descent leads on
    idle = np.isclose(reached, squares, rtol=_IDLE, atol=0.0)
    reached = np.where(idle & ~idle.all(), np.inf, reached)
    beside = _without_axis(so_far, x, kind.only_axis)
    if beside is not None:
        others = np.asarray(effect_starts(so_far.problem, kind, jnp.asarray(beside)))
        starts = np.concatenate([starts, others])
        reached = np.concatenate([reached, both.glance(others, so_far.around(beside)[1])])
    return starts[np.argsort(reached)[:_TRIED]]


def _without_axis(so_far: Descent, x: Matrix, axis: int | None) -> Matrix | None:
    """The unknowns of the model so far, fitted from `x` without `axis`; None where less than most of what is
    left is on that axis."""
    problem = so_far.problem
    if axis is None or problem.motion is not None:
        return None
    left = np.sum(so_far.rows(x[None]).error_n2[0] * np.asarray(problem.weight) ** 2, axis=0)
    if left[axis] < _MOST_OF_IT * left.sum():
        return None
    trust = np.where(np.arange(3) == axis, _NEXT_TO_NONE, 1.0) * np.ones((problem.trials, 1))
    others = replace(problem, trust=jnp.asarray(trust))
    return Descent(others, so_far.effects).descend(x, _STEPS)[0]


def _again(both: Descent, best: Matrix, reached: float, slope: Matrix) -> tuple[Matrix, float]:
    """The unknowns reached, or better ones from where else the last effect may have its best."""
    known = slope.shape[1]
    own = both.effects[-1].again(best[known:], both.problem.tool)
    if not len(own):
        return best, reached
    starts = np.concatenate([np.tile(best[:known], (len(own), 1)), own], axis=1)
    nearest = starts[np.argsort(both.glance(starts, slope))[:_TRIED_AGAIN]]
    return min([(best, reached), *(both.descend(one, _STEPS) for one in nearest)], key=lambda each: each[1])
