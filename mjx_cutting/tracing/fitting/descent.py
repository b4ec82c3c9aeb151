"""Short fits without automatic differentiation: many models, few compilations.

What costs time in trying thirty effects is not arithmetic but compiling each one's derivatives. Here only the
lines of a model are compiled for each set of effects, with little optimisation; comparing lines with
measurements is compiled once for a data set. Jacobians are forward differences, evaluated in one batch at the
phases of the point they belong to (Kaufman's, see `residual`); Gauss-Newton steps follow, each at the best of
several dampings. Of more than 64 unknowns the Jacobian is evaluated once and then updated from step to step,
until that leads no further.
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

from mjx_cutting import _platform
from mjx_cutting.cutting import ForceModel
from mjx_cutting.tracing.fitting.fit import COMPILER, STIFFNESS, Effects, Fit, in_air
from mjx_cutting.tracing.fitting.model_lines import model_lines
from mjx_cutting.tracing.fitting.problem import (
    Problem,
    beside_the_cuts,
    model_at,
    out_of_range,
    padded,
    shared_bias,
)
from mjx_cutting.tracing.fitting.residual import marks, residual_beside, residual_of_lines

_ROWS = 8
_STEP = 1e-4
_DAMPING = (1e-6, 1e-3, 1e-2, 1e-1, 1.0, 30.0)
_FOLD_DAMPING = (1e-6, 1e-2, 0.3)
_SETTLED = 3e-4
_FLAT = 1e-5
_ROUNDING = 1e-9
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
    trial; `turning` [n, R, P, 3] what turning it does (`Residual`).
    """

    left: Matrix
    error_n2: Matrix
    phase_rad: Matrix
    turning: Matrix

    def at(self, index: NDArray[np.integer]) -> Rows:
        """Some of the rows."""
        return Rows(*(each[index] for each in (self.left, self.error_n2, self.phase_rad, self.turning)))


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
        for _, (lines, bias, beyond, _) in self._batches(x):
            by_trial = [np.asarray(each)[:, :trials] for each in _compare(problem, lines, bias)]
            parts.append([*by_trial, np.asarray(beyond)])
        weighted, *rest, beside = (np.concatenate(side)[: len(x)] for side in zip(*parts, strict=True))
        return Rows(_residual(weighted, beside), *rest)

    def squares(self, x: Matrix) -> Matrix:
        """[n] sums of squares of the residuals at `x` [n, U], few of which are held at once."""
        batches = (self.rows(x[first : first + _ROWS]).left for first in range(0, len(x), _ROWS))
        return np.concatenate([np.sum(left**2, axis=1) for left in batches])

    def beside(self, x: Matrix, known: Rows, of: NDArray[np.integer]) -> Matrix:
        """[n, M + B] residuals at `x` [n, U], each close to one of the `known` rows, `of` [n] which."""
        problem, parts = self.padded, []
        more = ((0, 0), (0, problem.trials - self.problem.trials))
        for chosen, (lines, bias, beyond, _) in self._batches(x):
            near = known.at(of[chosen])
            phase, turning = np.pad(near.phase_rad, more), np.pad(near.turning, (*more, (0, 0), (0, 0)))
            weighted = np.asarray(_beside(problem, lines, bias, phase, turning))[:, : self.problem.trials]
            parts.append((weighted, np.asarray(beyond)))
        left, beside = (np.concatenate(side)[: len(x)] for side in zip(*parts, strict=True))
        return _residual(left, beside)

    def models(self, x: Matrix) -> ForceModel:
        """The force models at `x` [n, U], every value with a leading axis [n]."""
        parts = [model for _, (*_, model) in self._batches(x)]
        whole: ForceModel = jax.tree.map(lambda *leaves: np.concatenate(leaves)[: len(x)], *parts)
        return whole

    def mark(self, x: Matrix) -> Matrix:
        """[n, M] the lines at `x` [n, U] as they enter the residual, at the phases given."""
        problem, trials = self.padded, self.problem.trials
        phase = jnp.asarray(np.pad(np.broadcast_to(self.phase_rad, (trials,)), (0, problem.trials - trials)))
        parts = [np.asarray(_marks(problem, lines, phase))[:, :trials] for _, (lines, *_) in self._batches(x)]
        return np.concatenate(parts)[: len(x)].reshape(len(x), -1)

    def _batches(
        self, x: Matrix
    ) -> Iterator[tuple[NDArray[np.integer], tuple[Array, Array, Array, ForceModel]]]:
        """Which of `x` [n, U] are in each batch, and their lines."""
        for first in range(0, len(x), _ROWS):
            chosen = np.minimum(np.arange(first, first + _ROWS), len(x) - 1)
            yield chosen, _lines(self.padded, jnp.asarray(x[chosen]), self.effects)

    def around(self, x: Matrix, here: Rows | None = None) -> tuple[Matrix, Matrix]:
        """[M + B] residual at `x` [U], whose rows [1] are `here` where they are known, and its Jacobian
        [M + B, U] there, by forward differences."""
        here = self.rows(x[None]) if here is None else here
        moved = self.beside(x + _STEP * np.eye(len(x)), here, np.zeros(len(x), dtype=int))
        slope = np.transpose(moved - here.left[0]) / _STEP
        size = np.linalg.norm(slope, axis=0)
        # of what no measurement shows only rounding is left, along which the fit would wander
        return here.left[0], np.where(size > _ROUNDING * size.max(initial=0.0), slope, 0.0)

    def glance(self, starts: Matrix, known: Matrix) -> Matrix:
        """[n] sum of squares after the best of a few damped steps from each of `starts` [n, U].

        The steps are taken, because linear models promise what a resonance far from its place does not keep.

        Arguments: `known` [M + B', K] Jacobian in the first K unknowns, which the starts share, without the
            last effect's penalties.
        """
        size = starts.shape[1] - known.shape[1]
        here = self.rows(starts)
        close = starts[:, None] + _STEP * np.eye(starts.shape[1])[known.shape[1] :]
        moved = self.beside(close.reshape(-1, starts.shape[1]), here, np.repeat(np.arange(len(starts)), size))
        known = np.pad(known, ((0, here.left.shape[1] - len(known)), (0, 0)))
        steps = []
        for left, beside in zip(here.left, moved.reshape(len(starts), size, -1), strict=True):
            slope = np.column_stack([known, np.transpose(beside - left) / _STEP])
            normal, gradient = slope.T @ slope, slope.T @ left
            scale = _scale(normal)
            steps.append([np.linalg.solve(normal + damping * scale, gradient) for damping in _GLANCE])
        tries = starts[:, None] - np.asarray(steps)
        reached = self.squares(tries.reshape(-1, starts.shape[1]))
        return np.minimum(reached.reshape(len(starts), -1).min(axis=1), np.sum(here.left**2, axis=1))

    def descend(self, x: Matrix, steps: int) -> tuple[Matrix, float]:
        """Unknowns and sum of squares after at most `steps` Gauss-Newton steps from `x` [U]."""
        here, slope, squares = self.rows(x[None]), None, np.inf
        for _ in range(steps):
            known = slope is not None
            left = here.left[0]
            if slope is None:
                slope = self.around(x, here)[1]
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
            smooth = len(x) > _MANY and not self._beyond(after[1].left[0])
            slope = _updated(slope, after[0] - x, after[1].left[0] - left) if smooth else None
            x, here, squares = after
            if gained < _SETTLED * squares:
                break
        return x, squares

    def _step(
        self, x: Matrix, left: Matrix, slope: Matrix
    ) -> tuple[Matrix | None, tuple[Matrix, Rows, float]]:
        """The boldest damped step from `x`, of which residual [M + B] and Jacobian are given, where it leaves
        the ranges; where the best one leads, its rows [1], its sum of squares."""
        normal, gradient = slope.T @ slope, slope.T @ left
        scale = _scale(normal)
        tries = np.stack([x - np.linalg.solve(normal + damping * scale, gradient) for damping in _DAMPING])
        reached = self.rows(tries)
        each = np.sum(reached.left**2, axis=1)
        best = int(np.argmin(each))
        bold = tries[0] if self._beyond(reached.left[0]) else None
        return bold, (tries[best], reached.at(np.array([best])), float(each[best]))

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
        scale = np.stack([_scale(each) for each in normal])
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

    def squares_left(self, x: Matrix) -> Matrix:
        """[F] what is left over all trials at unknowns `x` [F, U], squared, weighted, without penalties."""
        return np.asarray(self.fits(x, np.ones((len(x), self.problem.trials))).squares)


def _residual(weighted: Matrix, beyond: Matrix) -> Matrix:
    """[n, M + B] finite, from what is left of the cuts [n, R, P, 3] and what stands beside them [n, B]."""
    left = np.concatenate([weighted.reshape(len(weighted), -1), beyond], axis=1)
    return np.clip(np.nan_to_num(left, nan=_HUGE), -_HUGE, _HUGE)


def _updated(slope: Matrix, step: Matrix, change: Matrix) -> Matrix:
    """The Jacobian after a `step` [U] that changed the residual by `change` [M + B]: the least change of it
    that agrees (Broyden, Math. Comp. 19 (1965) 577-593)."""
    return slope + np.outer(change - slope @ step, step) / max(float(step @ step), 1e-300)


def _scale(normal: Matrix) -> Matrix:
    """[U, U] what damping multiplies: the diagonal, kept above what forward differences make of an unknown
    that changes nothing, such as a phase where no tooth passing is heard: a step along it has no end."""
    return np.diag(np.diag(normal) + _FLAT * np.trace(normal) / len(normal) + 1e-12)


@partial(_platform.jit, static_argnums=2, compiler_options=COMPILER)
def _lines(problem: Problem, x: Array, effects: Effects) -> tuple[Array, Array, Array, ForceModel]:
    def one(x: Array) -> tuple[Array, Array, Array, ForceModel]:
        model = jax.tree.map(jnp.asarray, model_at(problem, x, effects))
        outside = STIFFNESS * jnp.clip(out_of_range(problem, x, effects), -_HUGE, _HUGE)
        beside = jnp.concatenate([beside_the_cuts(problem, x, model), outside])
        return model_lines(problem, model, heard=True), shared_bias(problem, x), beside, model

    return jax.vmap(one)(x)


@_platform.jit
def _compare(problem: Problem, lines: Array, bias_n: Array) -> tuple[Array, Array, Array, Array]:
    def one(lines: Array, bias_n: Array) -> tuple[Array, Array, Array, Array]:
        found = residual_of_lines(problem, lines, bias_n)
        return found.weighted, jnp.sum(found.remaining_n**2, axis=1), found.phase_rad, found.turning

    return jax.vmap(one)(lines, bias_n)


@_platform.jit
def _beside(problem: Problem, lines: Array, bias_n: Array, phase_rad: Array, turning: Array) -> Array:
    return jax.vmap(partial(residual_beside, problem))(lines, bias_n, phase_rad, turning)


@_platform.jit
def _marks(problem: Problem, lines: Array, phase_rad: Array) -> Array:
    return jax.vmap(partial(marks, problem, phase_rad=phase_rad))(lines)
