"""An option: a disturbance that is periodic at every moment but drifts in shape over the trial.

    k(t, t') = k_periodic(t, t') exp(-(t - t')^2 / (2 lambda^2))

The slow factor has Nystroem features at Chebyshev nodes of the window [0, T], psi(t) = k(t, u) L^-T with L
L' = k(u, u), and the product kernel the Kronecker features phi(t) x psi(t). Eight nodes are exact to 1e-7
while lambda is at least 0.4 T or so; `nodes_for` takes more where it is shorter. A rougher slow factor
(Matern) needs far more: use tinygp's quasiseparable solver for that.

Only the window was seen. Inside the simulation the slow time therefore runs forth and back over it (a
triangle wave), so an episode longer than the trials never leaves what was learned. The slow features are
polynomials there (Chebyshev), because the Nystroem form loses its digits in float32.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jax import Array
from jax.typing import ArrayLike
from numpy.typing import NDArray

from mjx_cutting import _platform
from mjx_cutting.disturbance.kernel import AbstractFiniteRank, fourier, log_prior, periodic_features
from mjx_cutting.disturbance.likelihood import Hyper, Rows, bounded, from_grams, unseen
from mjx_cutting.disturbance.search import STEPS, TOLERANCE, Found, decode, rows_of, units
from mjx_cutting.disturbance.statistics import Statistics

NODES = 12
JITTER = 1e-11
LEAST_SLOW = 0.25  # of the window: shorter than this a process is not periodic in any useful sense


def chebyshev_nodes(low_s: float, high_s: float, count: int) -> NDArray[np.float64]:
    """Returns the Chebyshev points [count] of [low, high], s."""
    angle = np.pi * (np.arange(count) + 0.5) / count
    return 0.5 * (low_s + high_s) - 0.5 * (high_s - low_s) * np.cos(angle)


def slow_features(time: Array, nodes: Array, slow_length: ArrayLike) -> Array:
    """Returns psi [n, q] with psi psi' the slow factor's covariance."""

    def covariance(a: Array, b: Array) -> Array:
        return jnp.exp(-0.5 * jnp.square((a[:, None] - b[None, :]) / slow_length))

    own = covariance(nodes, nodes) + JITTER * jnp.eye(nodes.shape[0], dtype=nodes.dtype)
    factor = jnp.linalg.cholesky(own)
    return jax.scipy.linalg.solve_triangular(factor, covariance(nodes, time), lower=True).T


class QuasiPeriodicKernel(AbstractFiniteRank):
    """The product kernel in finite rank for `FiniteRankSolver`; good between the end nodes."""

    period_s: ArrayLike
    length: ArrayLike
    amplitude: ArrayLike
    slow_length_s: ArrayLike
    nodes_s: Array  # [q] s
    harmonics: int = eqx.field(static=True, default=16)

    def evaluate(self, X1: Array, X2: Array) -> Array:
        sine = jnp.sin(jnp.pi * (X1 - X2) / self.period_s)
        slow = jnp.square((X1 - X2) / self.slow_length_s)
        return jnp.square(self.amplitude) * jnp.exp(-2.0 * jnp.square(sine / self.length) - 0.5 * slow)

    def features(self, X: Array) -> Array:
        phi = periodic_features(X, 1.0 / jnp.asarray(self.period_s), self.harmonics)
        return _kron(phi, slow_features(X, self.nodes_s, self.slow_length_s))

    def log_prior(self) -> Array:
        return jnp.repeat(log_prior(self.length, self.amplitude, self.harmonics), self.nodes_s.shape[0])


def _kron(phi: Array, psi: Array) -> Array:
    return (phi[:, :, None] * psi[:, None, :]).reshape(len(phi), -1)


def features(
    time_s: NDArray, frequency_hz: float, harmonics: int, nodes_s: NDArray, slow_length_s: float
) -> NDArray[np.float64]:
    """Returns the features [n, m q] on the host in float64, m = 2 J + 1 by q nodes."""
    phi = fourier(time_s, frequency_hz, harmonics)
    psi = slow_features_host(np.asarray(time_s, np.float64), nodes_s, slow_length_s)
    return (phi[:, :, None] * psi[:, None, :]).reshape(len(phi), -1)


def slow_features_host(time: NDArray, nodes: NDArray, slow_length: float) -> NDArray[np.float64]:
    """Returns psi [n, q] as `slow_features`, on the host."""
    own = np.exp(-0.5 * ((nodes[:, None] - nodes) / slow_length) ** 2) + JITTER * np.eye(len(nodes))
    cross = np.exp(-0.5 * ((time[:, None] - nodes) / slow_length) ** 2)
    return np.linalg.solve(np.linalg.cholesky(own), cross.T).T


@functools.lru_cache
def _objective(effects: str, harmonics: int) -> Callable:
    def raw(x, start_hz, reach_hz, shortest, slow_bounds, nodes, rows):
        hyper = decode(x[:-1], start_hz, reach_hz, shortest, effects)
        slow = _slow_length(x[-1], slow_bounds)
        phi = periodic_features(rows.time_s, hyper.frequency_hz, harmonics)
        basis = _kron(phi, slow_features(rows.time_s, nodes, slow))
        G = jax.lax.map(lambda w: (basis * w[:, None]).T @ basis, rows.weights)
        hidden = unseen(start_hz, rows.nyquist_hz, harmonics)
        repeat = functools.partial(jnp.repeat, repeats=nodes.shape[0], axis=-1)
        first = bounded(log_prior(hyper.length, hyper.amplitude, harmonics), rows.log_constant[0])
        common = own = repeat(first + hidden)
        if effects != "pooled":
            second = log_prior(hyper.trial_length, hyper.trial_amplitude, harmonics)
            own = repeat(bounded(second, rows.log_constant[1]) + hidden)
        return -from_grams(effects, G, rows.sums @ basis, (common, own), hyper.noise, rows)

    value = jax.custom_batching.sequential_vmap(raw)
    gradient = jax.custom_batching.sequential_vmap(jax.value_and_grad(raw))

    @jax.custom_jvp
    def smooth(*arguments):
        return value(*arguments)

    @smooth.defjvp
    def _(primals, tangents):
        found, slope = gradient(*primals)
        return found, slope @ tangents[0]

    return smooth


def _slow_length(x: Array, bounds: Array) -> Array:
    return jnp.exp(bounds[0] + (bounds[1] - bounds[0]) * jax.nn.sigmoid(x))


@functools.partial(_platform.jit, static_argnames=("effects", "harmonics"))
def _minimise(
    x0: Array,
    unit: Array,
    fixed: tuple[Array, ...],
    nodes: Array,
    rows: Rows,
    effects: str,
    harmonics: int,
) -> tuple[Array, Array]:
    smooth = _objective(effects, harmonics)

    def one(x: Array) -> tuple[Array, Array]:
        solution = optimistix.minimise(
            lambda y, _: smooth(x + unit * y, *fixed, nodes, rows),
            optimistix.BFGS(TOLERANCE, TOLERANCE),
            jnp.zeros_like(x),
            max_steps=STEPS,
            throw=False,
        )
        return x + unit * solution.value, solution.state.f_info.f

    return jax.vmap(one)(x0)


class Drifting(NamedTuple):
    """What the search with a slow factor returns."""

    hyper: Hyper  # NumPy arrays, scaled unit
    slow_length_s: float
    nodes_s: NDArray[np.float64]
    log_likelihood: float
    harmonics: int


def optimise(statistics: Statistics, periodic: Found, harmonics: int, shortest: float) -> Drifting:
    """Returns the optimum with a slow factor, searched from the periodic one with two slow lengths.

    Args:
        statistics: the trials.
        periodic: the optimum of the periodic process.
        harmonics: how many harmonics to keep (those that matter in the periodic fit).
        shortest: the least l.

    Raises:
        ValueError: no finite outcome.
    """
    span = statistics.span_s
    low, high = float(statistics.time_s[0]), float(statistics.time_s[-1])
    nodes = chebyshev_nodes(low, high, NODES)
    bounds = np.log([LEAST_SLOW * span, 50.0 * span])
    place = (np.log([0.5 * span, 3.0 * span]) - bounds[0]) / (bounds[1] - bounds[0])
    x = periodic.variables
    x0 = np.stack([np.append(x, np.log(p / (1 - p))) for p in place])
    curvature = np.asarray([statistics.count / 6.0 * (periodic.reach_hz * span) ** 2])
    unit = np.append(units(statistics, x[None], curvature)[0], 0.3)
    fixed = (periodic.start_hz, periodic.reach_hz, shortest, bounds)
    ends, values = _minimise(
        jnp.asarray(x0),
        jnp.asarray(unit),
        tuple(jnp.asarray(v) for v in fixed),
        jnp.asarray(nodes),
        rows_of(statistics, constants=True),
        statistics.effects,
        harmonics,
    )
    ends, values = np.asarray(ends), np.where(np.isfinite(values), values, np.inf)
    best = int(np.argmin(values))
    if not np.isfinite(values[best]):
        raise ValueError(
            "the search with a drifting shape ended in no finite number; use the periodic process, or "
            "check the "
            "residual for outliers"
        )
    args = (ends[best][:-1], periodic.start_hz, periodic.reach_hz, shortest)
    end, f0, near, least = (jnp.asarray(v) for v in args)
    hyper = decode(end, f0, near, least, statistics.effects)
    slow = float(_slow_length(jnp.asarray(ends[best][-1]), jnp.asarray(bounds)))
    return Drifting(
        Hyper(*(np.asarray(v, np.float64) for v in hyper)), slow, nodes, -float(values[best]), harmonics
    )
