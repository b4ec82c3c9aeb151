"""What a force model leaves of the measured lines, each trial's own unknowns solved inside.

A trial's phase and (where the sensor was zeroed before each trial) its bias are nuisances: for given lines
the phase is found by a search over the whole turn and a few Gauss-Newton steps, the bias in closed form. What
is returned is the whitened residual with both projected out, whose Jacobian in the global unknowns is
Kaufman's variable projection (Golub and Pereyra, Inverse Problems 19 (2003) R1-R26). Where the tool's motion
was measured, so was its angle, and only the bias is left.
"""

from __future__ import annotations

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.tracing.fitting.problem import Problem

_PHASES = 1024
_GAUSS_NEWTON = 4
_TERMS = 3


class Residual(eqx.Module):
    """What a model leaves of the measured lines.

    Fields:
        weighted: [R, P, 3] residual with nuisances projected out, in standard deviations.
        remaining_n: [R, P, 3] whitened residual with the nuisances at their best, N; its sum of squares is
            the squared error over the samples, less the part between the lines.
        phase_rad: [R] phase of each trial.
        bias_n: [R, 3] bias of each trial, N.
        turning: [R, P, 3] what turning a trial by its phase does to `weighted`, a unit vector of each trial,
            which is projected out; zero where the angle was measured.
    """

    weighted: Array
    remaining_n: Array
    phase_rad: Array
    bias_n: Array
    turning: Array


def residual_of_lines(problem: Problem, lines: Array, shared_bias_n: ArrayLike = 0.0) -> Residual:
    """Residual of every trial against given lines [R, orders + 1, 3], N."""
    shared = jnp.broadcast_to(jnp.asarray(shared_bias_n, dtype=float), (3,))
    solve = partial(_solve_trial, problem, shared)
    return jax.vmap(solve)(lines, problem.whitened, problem.factor, problem.present, problem.weights)


def residual_beside(
    problem: Problem, lines: Array, shared_bias_n: ArrayLike, phase_rad: Array, turning: Array
) -> Array:
    """[R, P, 3] weighted residual against lines [R, orders + 1, 3] close to some of which the phases [R] and
    `turning` [R, P, 3] are known: to first order what `residual_of_lines` gives, for fewer products."""
    shared = jnp.broadcast_to(jnp.asarray(shared_bias_n, dtype=float), (3,))
    solve = partial(_held_trial, problem, shared)
    known = problem.whitened, problem.factor, problem.present, problem.weights, phase_rad, turning
    return jax.vmap(solve)(lines, *known)


def as_measured(problem: Problem, lines: Array) -> Array:
    """[R, P, 3] lines [R, orders + 1, 3] as `Problem.whitened` holds those of a record."""
    real = jax.vmap(_real, in_axes=(0, 0, None))(lines, problem.present, problem.heard)
    return jnp.einsum("rqp,rqa->rpa", problem.factor, real)


def marks(problem: Problem, lines: Array, phase_rad: Array) -> Array:
    """[R, P, 3] lines [R, orders + 1, 3] at given phases [R], whitened and weighted as the residual is."""
    return as_measured(problem, jax.vmap(_turned)(lines, phase_rad)) * problem.weights[:, None]


def _solve_trial(
    problem: Problem,
    shared: Array,
    lines: Array,
    whitened: Array,
    factor: Array,
    present: Array,
    weight: Array,
) -> Residual:
    heard, bias = problem.heard, _Bias(problem, factor, weight)
    if problem.motion is not None:
        remaining = whitened - factor.T @ _real(lines, present, heard).at[0].add(shared)
        own_n = bias.best_n(remaining)
        left = remaining - jnp.outer(bias.constant, own_n)
        still = jnp.zeros_like(whitened)
        return Residual(bias.damped(remaining) * weight, left, jnp.zeros(()), own_n + shared, still)
    still = jax.lax.stop_gradient(lines)
    start = _best_phase(still, whitened, factor, weight, heard)
    teeth, turned = problem.tool.teeth, _turned(still, start)
    of_all = (np.arange(len(still)) % teeth == 0)[:, None]
    alike = _real(jnp.where(of_all, turned, 0.0), present, heard).at[0].add(shared)
    apart = bias.taken_out(whitened - factor.T @ alike)
    start = start + _whole_teeth(jnp.where(of_all, 0.0, turned), apart, factor, weight, teeth, heard)
    columns = _derivatives(_real(_turned(still, start), present, heard), _TERMS, heard)
    columns[0] = columns[0].at[0].add(shared)
    now, *slopes = jnp.split(-factor.T @ jnp.concatenate(columns, axis=1), 1 + _TERMS, axis=1)
    expansion = jnp.stack([bias.taken_out(each) * weight for each in (whitened + now, *slopes)])
    phase = jax.lax.stop_gradient(start + _least_turn(expansion.reshape(1 + _TERMS, -1)))
    real = _real(_turned(lines, phase), present, heard)
    turning = jax.lax.stop_gradient(_derivatives(real, 1, heard)[1])
    told, slope = jnp.split(factor.T @ jnp.concatenate([real.at[0].add(shared), turning], axis=1), 2, axis=1)
    remaining, slope = whitened - told, bias.taken_out(-slope) * weight
    projected = bias.damped(remaining) * weight
    slope = slope / jnp.sqrt(jnp.maximum(jnp.sum(slope**2), 1e-30))
    projected = projected - slope * jnp.sum(slope * projected)
    own_n = bias.best_n(remaining)
    return Residual(projected, remaining - jnp.outer(bias.constant, own_n), phase, own_n + shared, slope)


def _held_trial(
    problem: Problem,
    shared: Array,
    lines: Array,
    whitened: Array,
    factor: Array,
    present: Array,
    weight: Array,
    phase_rad: Array,
    turning: Array,
) -> Array:
    real = _real(_turned(lines, phase_rad), present, problem.heard)
    remaining = whitened - factor.T @ real.at[0].add(shared)
    projected = _Bias(problem, factor, weight).damped(remaining) * weight
    return projected - turning * jnp.sum(turning * projected)


class _Bias:
    """The bias of one trial, which is solved for in closed form under its prior.

    `constant` [P] is what a bias of 1 N adds to the whitened lines; `absorbed` [3] the share of what lies
    along it that a bias takes away.
    """

    def __init__(self, problem: Problem, factor: Array, weight: Array) -> None:
        self.constant = factor[0]
        self.norm = self.constant @ self.constant
        self.spread = problem.bias_spread_n
        freedom = (weight * self.spread) ** 2 * self.norm
        self.absorbed = freedom / (1.0 + freedom)

    def taken_out(self, value: Array) -> Array:
        """[P, A] less the best bias of it."""
        return value - jnp.outer(self.constant, self.absorbed * (self.constant @ value) / self.norm)

    def damped(self, value: Array) -> Array:
        """[P, A] of which the sum of squares is what the best bias leaves, and its prior with it."""
        keep = 1.0 - jnp.sqrt(1.0 - self.absorbed)
        return value - jnp.outer(self.constant, keep * (self.constant @ value) / self.norm)

    def best_n(self, value: Array) -> Array:
        """[3] the bias that leaves least, N."""
        return jnp.where(self.spread > 0.0, (self.constant @ value) / self.norm, 0.0)


def _derivatives(real: Array, highest: int, heard: Array) -> list[Array]:
    """[P, A] each: coefficients of 1, cos, sin of the orders `heard` [K], and their derivatives by the phase
    up to the highest."""
    order = heard[:, None]
    cosine, sine = real[1::2], real[2::2]
    turned = jnp.stack([order * sine, -order * cosine], axis=1).reshape(-1, real.shape[1])
    found = [real, jnp.concatenate([jnp.zeros_like(real[:1]), turned])]
    square = jnp.concatenate([jnp.zeros((1, 1)), jnp.repeat(order, 2, axis=0)]) ** 2
    while len(found) <= highest:
        found.append(-square * found[-2])
    return found


def _least_turn(expansion: Array) -> Array:
    """[] turn at which a residual, given by its value and derivatives [1 + terms, M], is least.

    Gauss-Newton on the Taylor series, of which only inner products are needed.
    """
    product = expansion @ expansion.T
    terms = len(product)
    factorial = np.cumprod([1.0, *range(1, terms)])

    def better(_: int, turn: Array) -> Array:
        value = turn ** np.arange(terms) / factorial
        slope = jnp.concatenate([jnp.zeros(1), value[:-1]])
        return turn - slope @ product @ value / jnp.maximum(slope @ product @ slope, 1e-30)

    return jax.lax.fori_loop(0, _GAUSS_NEWTON, better, jnp.zeros((), product.dtype))


def _turned(lines: Array, phase: Array) -> Array:
    """Lines of the same waveform with tooth 0 ahead by `phase`."""
    return lines * jnp.exp(1j * jnp.arange(lines.shape[0]) * phase)[:, None]


def _real(lines: Array, present: Array, heard: Array) -> Array:
    """[P, A] coefficients of 1, cos, sin of the orders `heard` [K] from complex lines [orders + 1, A]."""
    own = lines[heard]
    pairs = jnp.stack([2.0 * own.real, -2.0 * own.imag], axis=1).reshape(-1, lines.shape[1])
    return jnp.concatenate([lines.real[:1], pairs]) * present[:, None]


def _best_phase(lines: Array, whitened: Array, factor: Array, weight: Array, heard: Array) -> Array:
    """Phase on a grid of a turn at which the lines agree best with the measured ones, the mean left aside."""
    product = factor @ whitened
    measured = product[1::2] - 1j * product[2::2]
    agreement = jnp.sum(measured * jnp.conj(lines[heard]) * weight**2, axis=1)
    spectrum = jnp.zeros(_PHASES, dtype=agreement.dtype).at[heard].set(agreement)
    return 2.0 * jnp.pi / _PHASES * jnp.argmax(jnp.fft.fft(spectrum).real)


def _whole_teeth(lines: Array, apart: Array, factor: Array, weight: Array, teeth: int, heard: Array) -> Array:
    """Turn by whole teeth at which the lines that tell them apart agree best with the measured ones.

    In a finite record the mean and the lines of tooth passing leak into the small ones between. So these,
    `lines` [orders + 1, A], are compared with what a model of alike teeth leaves, `apart` [P, A] whitened.
    """
    product = factor @ apart
    measured = product[1::2] - 1j * product[2::2]
    agreement = jnp.sum(measured * jnp.conj(lines[heard]) * weight**2, axis=1)
    tooth = jnp.arange(teeth)[:, None]
    return 2.0 * jnp.pi / teeth * jnp.argmax((jnp.exp(-2j * np.pi / teeth * tooth * heard) @ agreement).real)
