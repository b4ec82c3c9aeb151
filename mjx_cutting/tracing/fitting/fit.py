"""Least-squares fits of a force model to the lines of all trials, or of all but some, from several starts.

Levenberg-Marquardt of optimistix on the reduced residual of `problem`, vmapped over starts and over sets of
trials; in float64. Physical ranges are kept by a stiff penalty outside them. A fit that does not converge is
a value (`ok` False), never an exception.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax import Array

from mjx_cutting import _platform
from mjx_cutting.cutting import AbstractEffect, ForceModel
from mjx_cutting.tracing.fitting.model_lines import model_lines
from mjx_cutting.tracing.fitting.problem import (
    CONSTANTS,
    Problem,
    beside_the_cuts,
    model_at,
    out_of_range,
    padded,
    rescaled,
    shared_bias,
)
from mjx_cutting.tracing.fitting.residual import residual_of_lines
from mjx_cutting.tracing.records.levels import LEVEL_KINDS

Effects = tuple[type[AbstractEffect], ...]
_TOLERANCE = 1e-4
_STEPS = 40
_DIFFERENCE = 1e-6
_ROWS = 4
STIFFNESS = 1e3
COMPILER = {"xla_backend_optimization_level": 1}
_DAMPING_OF_UNKNOWNS = 1e-3


class Fit(eqx.Module):
    """A fitted model; a leading axis [F] where several fits were made.

    Fields:
        x: [U] global unknowns.
        cost: [] half the sum of squared weighted residuals over the trials used, and of the penalties.
        squares: [] sum of squared weighted residuals over the trials used, and over levels in air.
        error_n2: [R, 3] squared error on the lines of EVERY trial, its own phase and bias fitted, N^2.
        model: the force model at `x`.
        ok: [] True where the result is finite.
    """

    x: Array
    cost: Array
    squares: Array
    error_n2: Array
    model: ForceModel
    ok: Array


def fit(problem: Problem, effects: Effects, starts: np.ndarray[Any, Any]) -> Fit:
    """The best fit to all trials over the starts [n, U]."""
    tries = _fit_rows(problem, effects, starts, np.ones((len(starts), problem.trials)))
    best = int(np.argmin(np.where(tries.ok, tries.cost, np.inf)))
    return jax.tree.map(lambda leaf: leaf[best], tries)


def fit_base(problem: Problem) -> tuple[Problem, Fit]:
    """The base model on all trials, and the problem weighted by what it leaves."""
    found = fit(problem, (), base_starts(problem))
    problem = reweighted(problem, found)
    return problem, fit(problem, (), np.asarray(found.x)[None])


def base_starts(problem: Problem) -> np.ndarray[Any, Any]:
    """[n, U] starts of the base model: ratios of radial to tangential force, of edge to chip force; no force
    along the tool's axis where nothing was recorded."""
    axial = float(problem.alive[2])
    rows = [
        [1.0, radial, 0.2 * axial, edge, radial * edge, 0.1 * axial * edge]
        for radial in (0.15, 0.5)
        for edge in (0.1, 1.0)
    ]
    bias = [0.0] * (3 if problem.shared_bias else 0)
    given = [value for each in problem.given for value in each.starts(problem.tool)[0]]
    return np.asarray([row + bias + given for row in rows])


def effect_starts(problem: Problem, kind: type[AbstractEffect], before: Array) -> np.ndarray[Any, Any]:
    """[n, U] starts of a model with one effect more, from the unknowns of the model without it."""
    return np.asarray([np.concatenate([before, start]) for start in kind.starts(problem.tool)])


def freedom(problem: Problem, found: Fit, told: int | None = None) -> int:
    """Degrees of freedom a fit to all trials leaves: numbers measured less phases, which levels do not have,
    and the unknowns that they tell, `told` of all."""
    unknowns = len(found.x) if told is None else told
    phases = 0 if problem.tool.kind in LEVEL_KINDS else problem.trials
    return max(lines_measured(problem) - phases - unknowns, 1)


def spread(problem: Problem, found: Fit) -> float:
    """Root mean square of the weighted residual per degree of freedom: 1 where the weights are right."""
    return float(np.sqrt(found.squares / freedom(problem, found)))


def lines_measured(problem: Problem) -> int:
    """Real numbers a fit is made to: present lines times axes on which anything was recorded, of a drill two,
    less the free biases; and the levels in air."""
    alive = np.array(problem.alive)
    axes = int(alive.sum())
    free = int(np.sum(alive & (np.asarray(problem.bias_spread_n) > 0.0))) * problem.trials
    return axes * (int(np.asarray(problem.present).sum()) + in_air(problem) // 3) - free


def in_air(problem: Problem) -> int:
    """Rows of a residual that are levels in air."""
    return 0 if problem.air is None else 3 * len(problem.air.samples)


def reweighted(problem: Problem, found: Fit) -> Problem:
    """The problem with its standard deviations set to what a fit to all trials leaves."""
    return rescaled(problem, max(spread(problem, found), 1e-3))


def _fit_rows(
    problem: Problem, effects: Effects, starts: np.ndarray[Any, Any], use: np.ndarray[Any, Any]
) -> Fit:
    """Fits in batches of one size, so that one compilation serves starts and held-out sets alike."""
    parts, more = [], padded(problem)
    use = np.pad(use, ((0, 0), (0, more.trials - problem.trials)))
    for first in range(0, len(starts), _ROWS):
        chosen = np.minimum(np.arange(first, first + _ROWS), len(starts) - 1)
        parts.append(_fit_batch(more, effects, jnp.asarray(starts[chosen]), jnp.asarray(use[chosen])))
    whole: Fit = jax.tree.map(lambda *leaves: np.concatenate([np.asarray(leaf) for leaf in leaves]), *parts)
    whole = jax.tree.map(lambda leaf: leaf[: len(starts)], whole)
    return eqx.tree_at(lambda fit: fit.error_n2, whole, whole.error_n2[:, : problem.trials])


def by_differences(function: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """The function [U] -> [...] with its derivative by forward differences: no derivative is compiled."""
    differenced = jax.custom_jvp(function)

    def jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
        (x,), (direction,) = primals, tangents
        values = jax.lax.map(function, jnp.concatenate([x[None], x + _DIFFERENCE * jnp.eye(len(x))]))
        slope = (values[1:] - values[0]) / _DIFFERENCE
        return values[0], jnp.tensordot(direction, slope, axes=1)

    differenced.defjvp(jvp)
    return differenced


@partial(_platform.jit, static_argnums=1, compiler_options=COMPILER)
def _fit_batch(problem: Problem, effects: Effects, starts: Array, use: Array) -> Fit:
    solver = optx.LevenbergMarquardt(rtol=_TOLERANCE, atol=_TOLERANCE)

    def lines_at(x: Array) -> Array:
        return model_lines(problem, model_at(problem, x, effects), heard=True)

    differenced = by_differences(lines_at)

    def misfit(x: Array, use_row: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        left = residual_of_lines(problem, differenced(x), shared_bias(problem, x))
        used = left.weighted * use_row[:, None, None]
        outside = STIFFNESS * out_of_range(problem, x, effects)
        air = beside_the_cuts(problem, x, model_at(problem, x, effects))
        unsure = _DAMPING_OF_UNKNOWNS * x[CONSTANTS:]
        squares = jnp.sum(used**2) + jnp.sum(air**2)
        cost = 0.5 * (squares + jnp.sum(outside**2))
        return (used, air, outside, unsure), (squares, cost, jnp.sum(left.remaining_n**2, axis=1))

    def one(start: Array, use_row: Array) -> Fit:
        solution = optx.least_squares(
            misfit, solver, start, args=use_row, has_aux=True, max_steps=_STEPS, throw=False
        )
        squares, cost, error = solution.aux
        model = jax.tree.map(jnp.asarray, model_at(problem, solution.value, effects))
        return Fit(solution.value, cost, squares, error, model, jnp.isfinite(cost))

    return jax.vmap(one)(starts, use)
