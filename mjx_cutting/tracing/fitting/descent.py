"""Short fits without automatic differentiation: many models, few compilations.

What costs time in trying thirty effects is not arithmetic but compiling each one's derivatives. Here only the
lines of a model are compiled for each set of effects, with little optimisation; comparing lines with
measurements is compiled once for a data set. Jacobians are forward differences, evaluated in one batch, and
Gauss-Newton steps follow, each at the best of several dampings. Of more than 64 unknowns the Jacobian is
evaluated once and then updated from step to step, until that leads no further.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property, partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from mjx_cutting.cutting import ForceModel
from mjx_cutting.tracing.fitting.fit import STIFFNESS, Effects, Fit, in_air
from mjx_cutting.tracing.fitting.problem import (
    Problem,
    beside_the_cuts,
    model_at,
    model_lines,
    out_of_range,
    padded,
    shared_bias,
)
from mjx_cutting.tracing.fitting.residual import marks, residual_of_lines

_COMPILER = {"xla_backend_optimization_level": 1}
_ROWS = 8
_STEP = 1e-4
_DAMPING = (1e-6, 1e-3, 1e-2, 1e-1, 1.0, 30.0)
_FOLD_DAMPING = (1e-6, 1e-2, 0.3)
_SETTLED = 3e-4
_HUGE = 1e9
_UNTOLD = 1e-3
_MANY = 64
_GLANCE = (1e-2, 1e-1, 1.0)
Matrix = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Rows:
    """What a model leaves, at many unknowns at once.

    Fields: `left` [n, M + B] weighted residual, then that of levels in air and the penalties outside the
    ranges; `error_n2` [n, R, 3] squared error of each trial and axis, N^2; `phase_rad` [n, R] phase of each
    trial.
    """

    left: Matrix
    error_n2: Matrix
    phase_rad: Matrix


@dataclass(frozen=True, eq=False)
class Descent:
    """A model with `effects` on `problem`; marks are given at the phases `phase_rad` [R]."""

    problem: Problem
    effects: Effects
    phase_rad: Matrix = field(default_factory=lambda: np.zeros(()))

    @cached_property
    def padded(self) -> Problem:
        """The problem as it is computed; only its first trials count."""
        return padded(self.problem)

    @property
    def measured(self) -> int:
        """Rows of a residual that are measured in cuts; levels in air and penalties follow them."""
        return int(np.prod(self.problem.whitened.shape))

    def told(self, x: Matrix) -> int:
        """How many combinations of the unknowns the measurements tell at `x` [U]: at one feed, say, the force
        of the chip is not told from that of the edge."""
        slope = self.around(x)[1][: self.measured + in_air(self.problem)]
        size = np.linalg.norm(slope, axis=0)
        shown = size > _UNTOLD * size.max(initial=1e-300)
        return int(np.linalg.matrix_rank(slope[:, shown] / size[shown], tol=_UNTOLD)) if shown.any() else 0

    def rows(self, x: Matrix) -> Rows:
        """Residuals at `x` [n, U]."""
        problem, trials, parts = self.padded, self.problem.trials, []
        for lines, bias, beyond, _ in self._batches(x):
            by_trial = [np.asarray(each)[:, :trials] for each in _compare(problem, lines, bias)]
            parts.append([*by_trial, np.asarray(beyond)])
        weighted, error, phase, beside = (np.concatenate(side)[: len(x)] for side in zip(*parts, strict=True))
        left = np.concatenate([weighted.reshape(len(x), -1), beside], axis=1)
        return Rows(np.clip(np.nan_to_num(left, nan=_HUGE), -_HUGE, _HUGE), error, phase)

    def models(self, x: Matrix) -> ForceModel:
        """The force models at `x` [n, U], every value with a leading axis [n]."""
        parts = [model for *_, model in self._batches(x)]
        whole: ForceModel = jax.tree.map(lambda *leaves: np.concatenate(leaves)[: len(x)], *parts)
        return whole

    def mark(self, x: Matrix) -> Matrix:
        """[n, M] the lines at `x` [n, U] as they enter the residual, at the phases given."""
        problem, trials = self.padded, self.problem.trials
        phase = jnp.asarray(np.pad(np.broadcast_to(self.phase_rad, (trials,)), (0, problem.trials - trials)))
        parts = [np.asarray(_marks(problem, lines, phase))[:, :trials] for lines, *_ in self._batches(x)]
        return np.concatenate(parts)[: len(x)].reshape(len(x), -1)

    def _batches(self, x: Matrix) -> Iterator[tuple[Array, Array, Array, ForceModel]]:
        for first in range(0, len(x), _ROWS):
            chosen = x[np.minimum(np.arange(first, first + _ROWS), len(x) - 1)]
            yield _lines(self.padded, jnp.asarray(chosen), self.effects)

    def around(self, x: Matrix, left: Matrix | None = None) -> tuple[Matrix, Matrix]:
        """[M + B] residual at `x` [U], `left` where it is known, and its Jacobian [M + B, U] there, by
        forward differences."""
        beside = x + _STEP * np.eye(len(x))
        if left is None:
            left, *moved = self.rows(np.concatenate([x[None], beside])).left
        else:
            moved = list(self.rows(beside).left)
        return left, np.transpose(np.asarray(moved) - left) / _STEP

    def glance(self, starts: Matrix, known: Matrix) -> Matrix:
        """[n] sum of squares after the best of a few damped steps from each of `starts` [n, U].

        The steps are taken, because linear models promise what a resonance far from its place does not keep.

        Arguments: `known` [M + B', K] Jacobian in the first K unknowns, which the starts share, without the
            last effect's penalties.
        """
        size = starts.shape[1] - known.shape[1]
        nearby = np.concatenate([np.zeros((1, size)), _STEP * np.eye(size)])
        tries = starts[:, None] + np.pad(nearby, ((0, 0), (known.shape[1], 0)))
        left = self.rows(tries.reshape(-1, starts.shape[1])).left.reshape(*tries.shape[:2], -1)
        known = np.pad(known, ((0, left.shape[-1] - len(known)), (0, 0)))
        steps = []
        for here, *beside in left:
            slope = np.column_stack([known, np.transpose(np.asarray(beside) - here) / _STEP])
            normal, gradient = slope.T @ slope, slope.T @ here
            scale = _scale(normal)
            steps.append([np.linalg.solve(normal + damping * scale, gradient) for damping in _GLANCE])
        tries = starts[:, None] - np.asarray(steps)
        reached = np.sum(self.rows(tries.reshape(-1, starts.shape[1])).left ** 2, axis=1)
        return np.minimum(reached.reshape(len(starts), -1).min(axis=1), np.sum(left[:, 0] ** 2, axis=1))

    def descend(self, x: Matrix, steps: int) -> tuple[Matrix, float]:
        """Unknowns and sum of squares after at most `steps` Gauss-Newton steps from `x` [U]."""
        left = slope = None
        squares = np.inf
        for _ in range(steps):
            known = slope is not None
            if left is None or slope is None:
                left, slope = self.around(x, left)
            squares = float(left @ left)
            bold, after = self._step(x, left, slope)
            settled = not after[2] < (1.0 - _SETTLED) * squares
            if settled and known:
                slope = None
                continue
            if settled and bold is not None:
                # the boldest step crossed a bound that its linear model did not see: come back
                after = min(after, self._step(bold, *self.around(bold))[1], key=lambda each: each[2])
            if not after[2] < squares:
                break
            gained = squares - after[2]
            smooth = len(x) > _MANY and not self._beyond(after[1])
            slope = _updated(slope, after[0] - x, after[1] - left) if smooth else None
            x, left, squares = after
            if gained < _SETTLED * squares:
                break
        return x, squares

    def _step(
        self, x: Matrix, left: Matrix, slope: Matrix
    ) -> tuple[Matrix | None, tuple[Matrix, Matrix, float]]:
        """The boldest damped step from `x`, of which residual [M + B] and Jacobian are given, where it leaves
        the ranges; where the best one leads, its residual, its sum of squares."""
        normal, gradient = slope.T @ slope, slope.T @ left
        scale = _scale(normal)
        tries = np.stack([x - np.linalg.solve(normal + damping * scale, gradient) for damping in _DAMPING])
        reached = self.rows(tries).left
        each = np.sum(reached**2, axis=1)
        best = int(np.argmin(each))
        bold = tries[0] if self._beyond(reached[0]) else None
        return bold, (tries[best], reached[best], float(each[best]))

    def _beyond(self, left: Matrix) -> bool:
        """Whether a residual [M + B] has penalties: unknowns beyond their ranges."""
        return bool(np.any(left[self.measured + in_air(self.problem) :]))

    def descend_folds(self, x: Matrix, use: Matrix, steps: int) -> Matrix:
        """[F, U] unknowns for every row of `use` [F, R], all from `x` [U], with the one Jacobian there.

        What a fold leaves out moves the optimum little, so the slope at the common start serves them all.
        """
        start, everywhere = self.around(x)
        penalties = len(start) - self.measured
        mask = np.repeat(use, self.measured // self.problem.trials, axis=1)
        mask = np.concatenate([mask, np.ones((len(use), penalties))], axis=1)
        normal = np.stack([(everywhere * row[:, None]).T @ everywhere for row in mask])
        diagonal = np.diagonal(normal, axis1=1, axis2=2)
        floor = 1e-9 * diagonal.sum(axis=1, keepdims=True) / len(x) + 1e-12
        scale = (diagonal + floor)[:, :, None] * np.eye(len(x))
        here, left = np.tile(x, (len(use), 1)), start * mask
        squares = np.sum(left**2, axis=1)
        for _ in range(steps):
            gradient = left @ everywhere
            damped = normal[:, None] + np.asarray(_FOLD_DAMPING)[:, None, None] * scale[:, None]
            tries = here[:, None] - np.linalg.solve(damped, gradient[:, None, :, None])[..., 0]
            reached = self.rows(tries.reshape(-1, len(x))).left.reshape(*tries.shape[:2], -1) * mask[:, None]
            each = np.sum(reached**2, axis=2)
            fold, best = np.arange(len(use)), np.argmin(each, axis=1)
            lower = each[fold, best] < squares
            gained = np.where(lower, squares - each[fold, best], 0.0)
            here = np.where(lower[:, None], tries[fold, best], here)
            left = np.where(lower[:, None], reached[fold, best], left)
            squares = np.minimum(squares, each[fold, best])
            if np.all(gained < _SETTLED * squares):
                break
        return here

    def fits(self, x: Matrix, use: Matrix) -> Fit:
        """The fits at unknowns `x` [F, U], each judged over the trials of its row of `use` [F, R]."""
        rows = self.rows(x)
        left = rows.left[:, : self.measured].reshape(len(x), self.problem.trials, -1)
        beside = rows.left[:, self.measured :]
        air = np.sum(beside[:, : in_air(self.problem)] ** 2, axis=1)
        squares = np.sum(np.sum(left**2, axis=2) * use, axis=1) + air
        cost = 0.5 * (squares - air + np.sum(beside**2, axis=1))
        return Fit(x, cost, squares, rows.error_n2, self.models(x), np.isfinite(cost))  # type: ignore[arg-type]


def _updated(slope: Matrix, step: Matrix, change: Matrix) -> Matrix:
    """The Jacobian after a `step` [U] that changed the residual by `change` [M + B]: the least change of it
    that agrees (Broyden, Math. Comp. 19 (1965) 577-593)."""
    return slope + np.outer(change - slope @ step, step) / max(float(step @ step), 1e-300)


def _scale(normal: Matrix) -> Matrix:
    """[U, U] what damping multiplies: the diagonal, kept above zero."""
    return np.diag(np.diag(normal) + 1e-9 * np.trace(normal) / len(normal) + 1e-12)


@partial(jax.jit, static_argnums=2, compiler_options=_COMPILER)
def _lines(problem: Problem, x: Array, effects: Effects) -> tuple[Array, Array, Array, ForceModel]:
    def one(x: Array) -> tuple[Array, Array, Array, ForceModel]:
        model = jax.tree.map(jnp.asarray, model_at(problem, x, effects))
        outside = STIFFNESS * jnp.clip(out_of_range(problem, x, effects), -_HUGE, _HUGE)
        beside = jnp.concatenate([beside_the_cuts(problem, x, model), outside])
        return model_lines(problem, model), shared_bias(problem, x), beside, model

    return jax.vmap(one)(x)


@jax.jit
def _compare(problem: Problem, lines: Array, bias_n: Array) -> tuple[Array, Array, Array]:
    def one(lines: Array, bias_n: Array) -> tuple[Array, Array, Array]:
        found = residual_of_lines(problem, lines, bias_n)
        return found.weighted, jnp.sum(found.remaining_n**2, axis=1), found.phase_rad

    return jax.vmap(one)(lines, bias_n)


@jax.jit
def _marks(problem: Problem, lines: Array, phase_rad: Array) -> Array:
    return jax.vmap(partial(marks, problem, phase_rad=phase_rad))(lines)
