"""The periodic kernel as a short sum of cosines, which makes a Gaussian process on it finite-dimensional.

    k(tau) = s^2 exp(-2 sin^2(pi tau / p) / l^2) = s^2 sum_j c_j cos(2 pi j tau / p),   kappa = 1 / l^2,
    c_0 = e^-kappa I_0(kappa),   c_j = 2 e^-kappa I_j(kappa),   sum_j c_j = 1  (Jacobi-Anger expansion)

so k(t, t') = phi(t)' S phi(t') with phi = [1, cos j theta, sin j theta], theta = 2 pi frac(t / p), m = 2 J
+ 1 features and the diagonal prior S = s^2 diag(c_0, c_j, c_j). The coefficients come from the continued
fraction of the Bessel ratio r_j = I_j / I_{j-1} = 1 / (2 j / kappa + r_{j+1}), run downwards, and a
cumulative sum of logarithms normalised to sum one: positive and differentiable, where a discrete Fourier
transform of the kernel goes negative in rounding. References: Abramowitz & Stegun 9.6.34, 9.1.73; Solin &
Sarkka, AISTATS 2014.

Breaks when the length l is so short that more than J harmonics matter: `tail` says how much variance is lost,
and everything here refuses above `MAX_TAIL`.
"""

from __future__ import annotations

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import tinygp
from jax import Array
from jax.typing import ArrayLike
from numpy.typing import NDArray

HARMONICS = 32
MAX_TAIL = 1e-8
_BEYOND = 20  # terms of the continued fraction past 2 J: where it starts no longer matters


def _ratios(kappa: Array, terms: int) -> Array:
    """Returns r_1 .. r_terms [terms, ...], r_j = I_j(kappa) / I_{j-1}(kappa)."""

    def down(r: Array, j: Array) -> tuple[Array, Array]:
        r = kappa / (2.0 * j + kappa * r)
        return r, r

    orders = jnp.arange(terms, 0, -1, dtype=kappa.dtype)
    _, ratios = jax.lax.scan(down, jnp.zeros_like(kappa), orders, unroll=min(terms, 16))
    return ratios[::-1]


@jax.custom_jvp
def _log_bessel(kappa: Array, harmonics: Array) -> Array:
    """Returns log(e^-kappa I_j(kappa)) for j = 0 .. terms, `harmonics` carrying only the length."""
    ratios = _ratios(kappa, harmonics.shape[0] - 1)
    relative = jnp.concatenate([jnp.zeros((1, *kappa.shape), kappa.dtype), jnp.cumsum(jnp.log(ratios), 0)])
    twice = jnp.where(harmonics > 0, jnp.log(2.0), 0.0).astype(kappa.dtype)
    twice = twice.reshape(-1, *([1] * kappa.ndim))
    return relative - jax.scipy.special.logsumexp(relative + twice, axis=0)


@_log_bessel.defjvp
def _log_bessel_jvp(primals, tangents):
    # I_j' = (I_{j-1} + I_{j+1}) / 2: d log(e^-k I_j) / dk = (1 / r_j + r_{j+1}) / 2 - 1, and r_1 - 1 at j = 0
    kappa, harmonics = primals
    value = _log_bessel(kappa, harmonics)
    step = jnp.exp(jnp.diff(value, axis=0))
    above = jnp.concatenate([step[1:], jnp.zeros((1, *kappa.shape), kappa.dtype)])
    slope = jnp.concatenate([step[:1] - 1.0, 0.5 * (1.0 / step + above) - 1.0])
    return value, slope * tangents[0]


@functools.partial(jax.jit, static_argnums=1, inline=True)  # outside jit a scan would compile at every call
def log_coefficients(length: ArrayLike, harmonics: int = HARMONICS) -> tuple[Array, Array]:
    """Returns (log c [harmonics + 1, ...], tail [...]): the cosine coefficients and the variance they miss.

    Args:
        length: the kernel's dimensionless l [...], above 0.
        harmonics: J, how many harmonics are kept.
    """
    kappa = 1.0 / jnp.square(jnp.asarray(length))
    orders = jnp.arange(2 * harmonics + _BEYOND + 1)
    logs = _log_bessel(kappa, orders)
    twice = jnp.where(orders > 0, jnp.log(2.0), 0.0).astype(logs.dtype)
    logs = logs + twice.reshape(-1, *([1] * kappa.ndim))
    return logs[: harmonics + 1], jnp.sum(jnp.exp(logs[harmonics + 1 :]), axis=0)


def log_prior(length: ArrayLike, amplitude: ArrayLike, harmonics: int = HARMONICS) -> Array:
    """Returns log diag(S) [..., 2 J + 1] in the order of `periodic_features`; amplitude is s, in any unit."""
    logs, _ = log_coefficients(length, harmonics)
    logs = jnp.moveaxis(logs, 0, -1)
    return jnp.concatenate([logs, logs[..., 1:]], -1) + 2.0 * jnp.log(jnp.asarray(amplitude))[..., None]


def prior(length: float, harmonics: int = HARMONICS) -> NDArray[np.float64]:
    """Returns diag(S) [2 J + 1] for unit amplitude, on the host in float64."""
    c = _coefficients(length, harmonics)[: harmonics + 1]
    return np.concatenate([c, c[1:]])


def tail(length: float, harmonics: int = HARMONICS) -> float:
    """Returns the share of the variance that the kept harmonics miss, on the host in float64."""
    return float(_coefficients(length, harmonics)[harmonics + 1 :].sum())


def _coefficients(length: float, harmonics: int) -> NDArray[np.float64]:
    kappa, terms = 1.0 / float(length) ** 2, 2 * harmonics + 200
    ratio, ratios = 0.0, np.zeros(terms)
    for j in range(terms, 0, -1):
        ratio = kappa / (2.0 * j + kappa * ratio)
        ratios[j - 1] = ratio
    value = np.concatenate([[1.0], 2.0 * np.cumprod(ratios)])
    return value / value.sum()


def fourier(time: NDArray, frequency: float, harmonics: int = HARMONICS) -> NDArray[np.float64]:
    """Returns the features [n, 2 J + 1] at `time` [n] as `periodic_features`, on the host in float64."""
    turns = np.asarray(time, np.float64) * frequency
    angle = 2.0 * np.pi * np.outer(turns - np.round(turns), np.arange(1, harmonics + 1))
    return np.concatenate([np.ones((len(angle), 1)), np.cos(angle), np.sin(angle)], 1)


def shortest_length(harmonics: int = HARMONICS) -> float:
    """Returns the shortest l whose tail stays below `MAX_TAIL` with that many harmonics."""
    low, high = 1e-3, 100.0
    for _ in range(60):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if tail(middle, harmonics) > MAX_TAIL else (low, middle)
    return high


@functools.partial(jax.jit, static_argnums=1, inline=True)
def powers(turns: Array, harmonics: int) -> tuple[Array, Array]:
    """Returns (cos, sin) [J, ...] of 2 pi j turns [...], j = 1 .. J, by repeated rotation (error ~ J ulp).

    One sine and cosine per time; a plain `jnp.cos(j * angle)` costs seven times as much on a CPU.
    """
    return _rotations(turns, harmonics)


@functools.partial(jax.custom_jvp, nondiff_argnums=(1,))
def _rotations(turns: Array, harmonics: int) -> tuple[Array, Array]:
    angle = 2.0 * jnp.pi * (turns - jnp.round(turns))
    first = jnp.cos(angle), jnp.sin(angle)

    def rotate(z: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        return (z[0] * first[0] - z[1] * first[1], z[0] * first[1] + z[1] * first[0]), z

    _, found = jax.lax.scan(rotate, first, None, length=harmonics, unroll=4)
    return found


@_rotations.defjvp
def _rotations_jvp(harmonics, primals, tangents):
    cos, sin = _rotations(primals[0], harmonics)
    rate = 2.0 * jnp.pi * jnp.arange(1, harmonics + 1).reshape(-1, *([1] * primals[0].ndim))
    rate = rate.astype(cos.dtype) * tangents[0]
    return (cos, sin), (-rate * sin, rate * cos)


def periodic_features(time: Array, frequency: ArrayLike, harmonics: int = HARMONICS) -> Array:
    """Returns phi [n, 2 J + 1] = [1, cos j theta, sin j theta] at `time` [n], theta = 2 pi frequency time."""
    cos, sin = powers(time * frequency, harmonics)
    return jnp.concatenate([jnp.ones_like(cos[:1]), cos, sin], 0).T


class AbstractFiniteRank(tinygp.kernels.Kernel):
    """A kernel with finitely many features: k(x, x') = features(x)' diag(prior) features(x').

    `mjx_cutting.disturbance.FiniteRankSolver` takes any of these.
    """

    def features(self, X: Array) -> Array:
        """Returns the features [n, m] at X [n]."""
        raise NotImplementedError

    def log_prior(self) -> Array:
        """Returns the logarithm of the diagonal prior [m]."""
        raise NotImplementedError

    def matmul(self, X1: Array, X2: Array | None = None, y: Array | None = None) -> Array:
        """Returns k(X1, X2) @ y in O(n m); as in tinygp X2 may be left out, the two then being `X1, y`."""
        left = self.features(X1)
        right, data = (left, X2) if y is None or X2 is None else (self.features(X2), y)
        weights = jnp.tensordot(right, jnp.asarray(y if data is None else data), axes=(0, 0))
        return left @ (jnp.exp(self.log_prior()).reshape(-1, *([1] * (weights.ndim - 1))) * weights)


class PeriodicKernel(AbstractFiniteRank):
    """The periodic kernel in its finite-rank form, a tinygp kernel over times [s].

    `evaluate` is the closed form; `features` and `log_prior` the expansion that the solver uses. The two
    differ by at most `tail(length, harmonics)` times the amplitude squared.
    """

    period_s: ArrayLike  # above 0, s
    length: ArrayLike  # l, dimensionless, above 0
    amplitude: ArrayLike  # s, the unit of the data (N)
    harmonics: int = eqx.field(static=True, default=HARMONICS)

    def evaluate(self, X1: Array, X2: Array) -> Array:
        sine = jnp.sin(jnp.pi * (X1 - X2) / self.period_s)
        return jnp.square(self.amplitude) * jnp.exp(-2.0 * jnp.square(sine / self.length))

    def features(self, X: Array) -> Array:
        return periodic_features(X, 1.0 / jnp.asarray(self.period_s), self.harmonics)

    def log_prior(self) -> Array:
        return log_prior(self.length, self.amplitude, self.harmonics)


def as_finite_rank(kernel: tinygp.kernels.Kernel, harmonics: int = HARMONICS) -> AbstractFiniteRank:
    """Returns a finite-rank form of `kernel`: one of ours as it is, or `constant * ExpSineSquared` converted.

    Args:
        kernel: an `AbstractFiniteRank`, or tinygp's ExpSineSquared(scale=p, gamma=2 / l^2) with or without a
            constant factor.
        harmonics: J for a converted kernel.

    Raises:
        ValueError: any other kernel.
    """
    if isinstance(kernel, AbstractFiniteRank):
        return kernel
    factors = _factors(kernel)
    constants = [f for f in factors if isinstance(f, tinygp.kernels.Constant)]
    periodic = [f for f in factors if isinstance(f, tinygp.kernels.ExpSineSquared)]
    if len(periodic) != 1 or len(constants) + 1 != len(factors):
        raise ValueError(
            f"FiniteRankSolver got a {type(kernel).__name__} kernel; expected PeriodicKernel, another "
            "AbstractFiniteRank, "
            "or constant * tinygp.kernels.ExpSineSquared. Write the kernel in one of these forms, or use "
            "tinygp's own solvers."
        )
    variance = jnp.asarray(1.0)
    for constant in constants:
        variance = variance * jnp.asarray(constant.value)
    length = jnp.sqrt(2.0 / jnp.asarray(periodic[0].gamma))
    return PeriodicKernel(periodic[0].scale, length, jnp.sqrt(variance), harmonics)


def _factors(kernel: tinygp.kernels.Kernel) -> list[tinygp.kernels.Kernel]:
    if isinstance(kernel, tinygp.kernels.Product):
        return _factors(kernel.kernel1) + _factors(kernel.kernel2)
    return [kernel]
