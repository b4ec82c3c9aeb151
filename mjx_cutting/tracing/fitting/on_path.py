"""A model fitted to whole records, its lines changing along the path of each.

Lines of a stretch hold its mean, and where a response changes all along a record, as at the end of a sheet,
that is next to nothing of the higher lines. So from a fit to such means Gauss and Newton's steps are made on
the records themselves: what each unknown changes follows the path as the force does, and of each trial its
phase, the speed of its spindle and its bias are projected out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from mjx_cutting import _platform
from mjx_cutting.tracing.fitting.fit import STIFFNESS, Effects
from mjx_cutting.tracing.fitting.moving import MovingLines
from mjx_cutting.tracing.fitting.prediction import KNOTS, along_the_path, predictions
from mjx_cutting.tracing.fitting.problem import Problem, beside_the_cuts, model_at, out_of_range, shared_bias
from mjx_cutting.tracing.fitting.tuned import refined_angle
from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.tracing.records.lines import Lines
from mjx_cutting.trials.dataset import Dataset

_KNOTS_OF_SLOPES = 65
_STEPS = 6
_SETTLED = 0.02
_HALVINGS = 3
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class _Linear:
    """What is left at some unknowns and what these change, trial by trial: [R] squared weighted residual, [R,
    U, U] normal matrix, [R, U] slope, and the same of what is beside the trials (`other`)."""

    squares: Array
    normal: Array
    slope: Array
    other: tuple[float, Array, Array]

    @property
    def cost(self) -> float:
        return float(self.squares.sum()) + self.other[0]

    def step(self, used: NDArray[np.bool_]) -> Array:
        """[U] Gauss and Newton's step of a fit to the trials `used` [R]."""
        _, normal, slope = self.other
        return np.linalg.lstsq(
            normal + self.normal[used].sum(axis=0), slope + self.slope[used].sum(axis=0), rcond=1e-12
        )[0]


def fit_on_path(
    dataset: Dataset,
    lines: Lines,
    problem: Problem,
    effects: Effects,
    x: Array,
    fold: NDArray[np.int64],
) -> tuple[Array, Array]:
    """[U] unknowns of the best fit to whole records, from `x` [U] near it, and [F, U] those with each fold of
    trials, `fold` [R], left out, to first order (call it in float64)."""
    records = _Records(dataset, lines, problem, effects, x)
    every = np.ones(len(fold), bool)
    now = records.linear(x)
    for _ in range(_STEPS):
        before, step = now.cost, now.step(every)
        there = records.linear(x + step)
        for _ in range(_HALVINGS):
            if there.cost <= (1.0 + _SETTLED) * before:
                break
            step = 0.5 * step
            there = records.linear(x + step)
        if there.cost < before:
            x, now = x + step, there
        if now.cost > (1.0 - _SETTLED) * before:
            break
    return x, np.stack([x + now.step(fold != f) for f in range(int(fold.max()) + 1)])


class _Records:
    """Whole records of trials as a function of the unknowns, from `x` [U] on; each trial's angle is kept from
    one place to the next."""

    def __init__(self, dataset: Dataset, lines: Lines, problem: Problem, effects: Effects, x: Array):
        self.lines, self.problem, self.effects = lines, problem, effects
        self.rate_hz = dataset.sensor.sample_rate_hz
        self.trials = [trial for trial in dataset.trials if trial.kind == "cut"]
        model, bias = model_at(problem, jnp.asarray(x), effects), shared_bias(problem, jnp.asarray(x))
        told = predictions(dataset, lines, problem, model, bias)
        self.angle_rad = [each.angle_rad for each in told]
        self.measured_n = [each.measured_n for each in told]

    def linear(self, x: Array) -> _Linear:
        """What is left at unknowns [U], and what these change."""
        at = jnp.asarray(x)
        places, slopes = (np.asarray(each) for each in _slopes(self.problem, self.effects, at))
        parts = [self._one(index, places[index], slopes[index]) for index in range(len(self.trials))]
        squares, normal, slope = (np.stack(part) for part in zip(*parts, strict=True))
        rows, matrix = (np.asarray(each) for each in _beside(self.problem, self.effects, at))
        other = float(rows @ rows), matrix.T @ matrix, -matrix.T @ rows
        return _Linear(squares, normal, slope, other)

    def _one(self, index: int, places: NDArray, slopes: NDArray) -> tuple[float, Array, Array]:
        """Squared residual, normal matrix and slope of one trial, from its lines [K, orders + 1, 3] and what
        the unknowns change them [fewer K, orders + 1, 3, U]."""
        trial, measured = self.trials[index], self.measured_n[index]
        weight = np.asarray(self.problem.weights)[index]
        known = trial.spindle_angle_rad is not None
        angle = refined_angle(self._moving(index, places), self.angle_rad[index], known, measured, weight)
        self.angle_rad[index] = angle
        turning = 1j * np.arange(places.shape[1])[:, None] * places
        force, turned = np.split(
            self._moving(index, np.concatenate([places, turning], axis=-1)).force(angle), 2, axis=1
        )
        by_unknown = np.concatenate(np.moveaxis(slopes, -1, 0), axis=-1)
        changed = np.split(self._moving(index, by_unknown).force(angle), slopes.shape[-1], axis=1)
        left = measured - force
        own = [turned] if known else [turned, turned * (angle - angle.mean())[:, None]]
        if not self.problem.shared_bias:
            left = left - left.mean(axis=0)
            own += [np.tile(axis, (len(left), 1)) for axis in np.eye(3)]
        nuisance = np.linalg.qr(_flat(own, weight))[0]
        matrix = _flat(changed, weight)
        matrix -= nuisance @ (nuisance.T @ matrix)
        rest = (left * weight).ravel()
        return float(rest @ rest), matrix.T @ matrix, matrix.T @ rest

    def _moving(self, index: int, places: NDArray) -> MovingLines:
        return MovingLines(self.lines, index, places, along_path(self.trials[index]), self.rate_hz)


def _flat(columns: Sequence[Array], weight: Array) -> Array:
    """[3 T, n] columns [T, 3], weighted."""
    return np.stack([(each * weight).ravel() for each in columns], axis=1)


@partial(_platform.jit, static_argnums=1)
def _slopes(problem: Problem, effects: Effects, x: jax.Array) -> tuple[jax.Array, jax.Array]:
    """[R, K, orders + 1, 3] lines along the path of every trial; [R, fewer K, orders + 1, 3, U] what each
    unknown changes them."""

    def along(x: jax.Array, knots: int) -> jax.Array:
        places = along_the_path(problem, model_at(problem, x, effects), knots)
        return places.at[..., 0, :].add(shared_bias(problem, x))

    fewer = partial(along, knots=_KNOTS_OF_SLOPES)
    _, changed = jax.lax.map(lambda way: jax.jvp(fewer, (x,), (way,)), jnp.eye(len(x)))
    return along(x, KNOTS), jnp.moveaxis(changed, 0, -1)


@partial(_platform.jit_for_few_calls, static_argnums=1)
def _beside(problem: Problem, effects: Effects, x: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Residuals of levels in air and of leaving the physical ranges, and what each unknown changes them."""

    def rows(x: jax.Array) -> jax.Array:
        outside = STIFFNESS * out_of_range(problem, x, effects)
        return jnp.concatenate([beside_the_cuts(problem, x, model_at(problem, x, effects)).ravel(), outside])

    return rows(x), jax.jacfwd(rows)(x)
