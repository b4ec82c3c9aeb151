"""A first look at every effect of the library: a short fit of each beside the model so far, to choose which
are worth a full one, and what of each the trials could show at all.

A full fit with its held-out repetitions costs a compilation of several seconds an effect. Here only the
residual is compiled; its Jacobian comes from forward differences, all starts in one batch, and a few damped
Gauss-Newton steps of the normal equations follow from the best start. From the same Jacobians come the two
figures of an isolability analysis: how much of an effect's mark on the lines survives refitting what is in
the model already (phases and biases with it), and the cosine between what survives of two effects (Frank and
Ding, Automatica 33 (1997) 87-97, for the idea).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.fit import Effects, effect_starts
from mjx_cutting.tracing.problem import Problem, marks, model_at, out_of_range, residual

_COMPILER = {"xla_backend_optimization_level": 1}
_ROWS = 24
_STEP = 1e-4
_FIRST_STEPS = 2
_STEPS = 8
_DAMPING = (1e-6, 1e-3, 1e-2, 1e-1, 1.0, 30.0)
_STIFFNESS = 1e3
_SETTLED = 3e-4
_EXPLAINS = 1e-2
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
    so_far = _Model(problem, effects, np.asarray(residual(problem, x, effects).phase_rad))
    here = np.asarray(x)
    squares, slope = so_far.squares(here[None])[0], so_far.slope(here)[: so_far.measured]
    span = np.linalg.qr(slope)[0]
    found = []
    for kind in kinds:
        progress(f"screening {kind.name}")
        found.append(_screen(so_far, here, squares, span, kind))
    return tuple(sorted(found, key=lambda each: -each.share))


@dataclass(frozen=True, eq=False)
class _Model:
    """Residuals of a model at many unknowns at once; its marks are given at the phases `phase_rad` [R]."""

    problem: Problem
    effects: Effects
    phase_rad: Matrix

    @property
    def measured(self) -> int:
        """Rows of the residual that are measurements; penalties follow them."""
        return int(np.prod(self.problem.whitened.shape))

    def rows(self, x: Matrix) -> tuple[Matrix, Matrix]:
        """[n, M + B] residual with the penalties outside the ranges; [n, M] mark on the lines."""
        parts = []
        for first in range(0, len(x), _ROWS):
            chosen = x[np.minimum(np.arange(first, first + _ROWS), len(x) - 1)]
            parts.append(_look(self.problem, jnp.asarray(chosen), jnp.asarray(self.phase_rad), self.effects))
        left, mark = (
            np.concatenate([np.asarray(each) for each in side]) for side in zip(*parts, strict=True)
        )
        return np.nan_to_num(left[: len(x)], nan=1e6, posinf=1e6, neginf=-1e6), mark[: len(x)]

    def squares(self, x: Matrix) -> Matrix:
        """[n] sum of squared residuals."""
        return np.sum(self.rows(x)[0] ** 2, axis=1)

    def slope(self, x: Matrix) -> Matrix:
        """[M + B, U] Jacobian by forward differences."""
        left = self.rows(np.concatenate([x[None], x + _STEP * np.eye(len(x))]))[0]
        return np.transpose(left[1:] - left[0]) / _STEP


def _screen(so_far: _Model, x: Matrix, squares: float, span: Matrix, kind: type[AbstractEffect]) -> Screened:
    both = _Model(so_far.problem, (*so_far.effects, kind), so_far.phase_rad)
    starts = np.asarray(effect_starts(so_far.problem, kind, jnp.asarray(x)))
    tries = [_descend(both, start, _FIRST_STEPS) for start in starts]
    best, reached = _descend(both, min(tries, key=lambda each: each[1])[0], _STEPS)
    share = max(0.0, 1.0 - reached / max(squares, 1e-300))
    shown = best if share > _EXPLAINS else starts[0]
    with_it, marked = both.rows(shown[None])
    without, unmarked = so_far.rows(shown[None, : len(x)])
    effect = with_it[0, : so_far.measured] - without[0, : so_far.measured]
    surviving = effect - span @ (span.T @ effect)
    size, whole = float(np.linalg.norm(surviving)), float(np.linalg.norm(marked - unmarked))
    direction = surviving / max(size, 1e-300)
    return Screened(kind, best, share, min(1.0, size / max(whole, 1e-300)), size, direction)


def _descend(model: _Model, x: Matrix, steps: int) -> tuple[Matrix, float]:
    """Unknowns and squared residual after at most `steps` Gauss-Newton steps, each at its best damping."""
    left = model.rows(x[None])[0][0]
    squares = float(left @ left)
    for _ in range(steps):
        slope = model.slope(x)
        normal, gradient = slope.T @ slope, slope.T @ left
        scale = np.diag(np.diag(normal) + 1e-9 * np.trace(normal) / len(x) + 1e-12)
        tries = np.stack([x - np.linalg.solve(normal + damping * scale, gradient) for damping in _DAMPING])
        reached = model.rows(tries)[0]
        each = np.sum(reached**2, axis=1)
        best = int(np.argmin(each))
        if not each[best] < squares:
            break
        gained = squares - float(each[best])
        x, left, squares = tries[best], reached[best], float(each[best])
        if gained < _SETTLED * squares:
            break
    return x, squares


@partial(jax.jit, static_argnums=3, compiler_options=_COMPILER)
def _look(problem: Problem, x: Array, phase_rad: Array, effects: Effects) -> tuple[Array, Array]:
    def one(x: Array) -> tuple[Array, Array]:
        left = residual(problem, x, effects).weighted
        outside = _STIFFNESS * out_of_range(problem, x, effects)
        mark = marks(problem, model_at(problem, x, effects), phase_rad)
        return jnp.concatenate([left.ravel(), outside]), mark.ravel()

    return jax.vmap(one)(x)
