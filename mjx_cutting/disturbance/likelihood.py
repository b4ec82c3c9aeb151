"""The exact log likelihood of trials under the periodic process, from moments of the samples.

With z = e^{i theta} the moments are M_j = sum_i w_i z_i^j. G = Phi' W Phi is Toeplitz plus Hankel in them,
and

    A = I + S^1/2 G S^1/2 / sigma^2,   r = S^1/2 Phi' y / sigma^2,   v = A^-1 r,
    log p = r.v / 2 - log|A| / 2 - sum y^2 / (2 sigma^2) - (n / 2) log(2 pi sigma^2).

Derivatives by A are -(A^-1 + v v') / 2, by r they are v, by frequency the moments of t w: so nothing is
differentiated through a factorisation or through powers of z. Trial effects: y_r = g + h_r + noise with
priors S_0, S_1. With a full rectangle of trials the mean channel has the prior R S_0 + S_1 and the R - 1
contrasts S_1; with gaps the h_r are integrated out trial by trial first (matrix inversion lemma).

The cores run one at a time (`sequential_vmap`): jaxlib's batched LAPACK on a CPU waits inside the thread pool
that it was scheduled on, and several at once hang a two-core machine. float64 only: in float32 the value is
wrong by nats.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.disturbance.kernel import log_prior, powers

_BLOCK = 1250  # stamps summed at once
_NEVER = -700.0  # as a log prior: nothing, yet finite


class Rows(NamedTuple):
    """The part of `Statistics` that the likelihood reads, as float64 arrays."""

    time_s: Array  # [N]
    weights: Array  # [G, N]
    sums: Array  # [C, A, N]
    square: Array  # [A]
    samples: Array  # [] of each axis
    nyquist_hz: Array  # [] half the sample rate; inf for uneven stamps
    log_constant: Array  # [2, A] logarithm of the variance bounding each process's constant; large: none


class Hyper(NamedTuple):
    """Hyperparameters, amplitudes and noise in the unit of the data: JAX arrays inside, NumPy outside."""

    frequency_hz: Any  # [] above 0
    length: Any  # [A] l of the common process, dimensionless
    amplitude: Any  # [A] s of the common process
    trial_length: Any  # [A] l of a trial's own process
    trial_amplitude: Any  # [A] s of a trial's own process; 0 where there are no trial effects
    noise: Any  # [A] standard deviation of the independent noise


def _moments(
    harmonics: int, frequency: Array, time: Array, weights: Array, sums: Array, slopes: bool = False
) -> tuple[Array, ...]:
    """Returns Re, Im [G, 2 J] of sum_i w_i z_i^j, j = 1 .. 2 J, and Re, Im [C, J] of sum_i y_i z_i^j.

    With `slopes` the same of t w and t y follow behind them, [2 G, 2 J] and [2 C, J]. Long records are summed
    block by block, so that the powers of z and the rows stay in the processor's cache.
    """
    blocks, rest = divmod(len(time), _BLOCK)
    rows = (time, weights, sums)
    if blocks < 2:
        return _block_moments(harmonics, frequency, time, weights, sums, slopes)

    def add(i: Array, total: tuple[Array, ...]) -> tuple[Array, ...]:
        t, w, y = (jax.lax.dynamic_slice_in_dim(row, i * _BLOCK, _BLOCK, -1) for row in rows)
        found = _block_moments(harmonics, frequency, t, w, y, slopes)
        return tuple(t + f for t, f in zip(total, found, strict=True))

    t, w, y = (row[..., len(time) - _BLOCK - rest :] for row in rows)
    return jax.lax.fori_loop(0, blocks - 1, add, _block_moments(harmonics, frequency, t, w, y, slopes))


def _block_moments(
    harmonics: int, frequency: Array, time: Array, weights: Array, sums: Array, slopes: bool
) -> tuple[Array, ...]:
    if slopes:
        weights, sums = (jnp.concatenate([rows, rows * time], 0) for rows in (weights, sums))
    cos, sin = powers(time * frequency, harmonics)
    blocks, channels = len(weights), len(sums)
    stacked = jnp.concatenate([weights, sums, weights * cos[-1], weights * sin[-1]], 0)
    re, im = stacked @ cos.T, stacked @ sin.T
    high = blocks + channels
    above_re = re[high : high + blocks] - im[high + blocks :]  # z^(J + j) = z^J z^j
    above_im = im[high : high + blocks] + re[high + blocks :]
    low_re, low_im = jnp.concatenate([re[:blocks], above_re], 1), jnp.concatenate([im[:blocks], above_im], 1)
    return low_re, low_im, re[blocks:high], im[blocks:high]


def _plain_moments(harmonics, frequency, time, weights, sums):
    return _moments(harmonics, frequency, time, weights, sums)


def _moments_forward(harmonics, frequency, time, weights, sums):
    g, c = len(weights), len(sums)
    w_re, w_im, y_re, y_im = _moments(harmonics, frequency, time, weights, sums, True)
    rate = 2.0 * jnp.pi * jnp.arange(1, 2 * harmonics + 1, dtype=time.dtype)
    low = rate[:harmonics]
    slopes = (-rate * w_im[g:], rate * w_re[g:], -low * y_im[c:], low * y_re[c:])
    return (w_re[:g], w_im[:g], y_re[:c], y_im[:c]), (slopes, time, weights, sums)


def _moments_backward(harmonics, saved, bars):
    slopes, time, weights, sums = saved
    slope = sum(jnp.sum(bar * d) for bar, d in zip(bars, slopes, strict=True))
    return slope, jnp.zeros_like(time), jnp.zeros_like(weights), jnp.zeros_like(sums)


_smooth_moments = jax.custom_vjp(_plain_moments, nondiff_argnums=(0,))
_smooth_moments.defvjp(_moments_forward, _moments_backward)


def grams(frequency: Array, rows: Rows, harmonics: int) -> tuple[Array, Array]:
    """Returns (G [G, m, m], Phi' y [C, A, m]) at a frequency [Hz], features in the order of `kernel`.

    Differentiable by the frequency alone; the rows count as constants.
    """
    channels, axes = rows.sums.shape[:2]
    flat = rows.sums.reshape(channels * axes, -1)
    w_re, w_im, y_re, y_im = _smooth_moments(harmonics, frequency, rows.time_s, rows.weights, flat)
    C = jnp.concatenate([jnp.sum(rows.weights, -1, keepdims=True), w_re], -1)
    S = jnp.concatenate([jnp.zeros_like(w_im[:, :1]), w_im], -1)
    projected = jnp.concatenate([jnp.sum(flat, -1, keepdims=True), y_re, y_im], -1)
    return _toeplitz_hankel(C, S, harmonics), projected.reshape(channels, axes, -1)


def _toeplitz_hankel(C: Array, S: Array, harmonics: int) -> Array:
    i = np.arange(harmonics + 1)
    minus, plus = i[:, None] - i[None, :], i[:, None] + i[None, :]
    near, far, odd = C[..., np.abs(minus)], C[..., plus], jnp.sign(minus) * S[..., np.abs(minus)]
    cc, ss = 0.5 * (near + far), 0.5 * (near - far)
    cs = 0.5 * (S[..., plus] - odd)  # cos_i sin_j = (sin(i + j) - sin(i - j)) / 2
    top = jnp.concatenate([cc, cs[..., :, 1:]], -1)
    bottom = jnp.concatenate([jnp.swapaxes(cs, -1, -2)[..., 1:, :], ss[..., 1:, 1:]], -1)
    return jnp.concatenate([top, bottom], -2)


@jax.custom_batching.sequential_vmap
def _core_value(A: Array, r: Array) -> Array:
    factor = jnp.linalg.cholesky(A)
    half = jax.scipy.linalg.solve_triangular(factor, r, lower=True)
    return 0.5 * jnp.sum(half**2) - r.shape[1] * jnp.sum(jnp.log(jnp.diagonal(factor)))


@jax.custom_batching.sequential_vmap
def _core_gradient(A: Array, r: Array) -> tuple[Array, Array, Array]:
    factor = jnp.linalg.cholesky(A)
    eye = jnp.eye(len(A), dtype=A.dtype)
    solved = jax.scipy.linalg.cho_solve((factor, True), jnp.concatenate([eye, r], 1))
    inverse, v = solved[:, : len(A)], solved[:, len(A) :]
    value = 0.5 * jnp.sum(r * v) - r.shape[1] * jnp.sum(jnp.log(jnp.diagonal(factor)))
    return value, -0.5 * (r.shape[1] * inverse + v @ v.T), v


@jax.custom_vjp
def evidence(A: Array, r: Array) -> Array:
    """Returns sum over columns of r.A^-1 r / 2 - log|A| / 2 for A [m, m] and r [m, c]."""
    return _core_value(A, r)


def _evidence_forward(A, r):
    value, by_A, by_r = _core_gradient(A, r)
    return value, (by_A, by_r)


def _evidence_backward(saved, bar):
    return bar * saved[0], bar * saved[1]


evidence.defvjp(_evidence_forward, _evidence_backward)


def _scaled(G: Array, b: Array, half_prior: Array, noise: Array) -> tuple[Array, Array]:
    """Returns (A, r) of one block: half_prior [m] is S^1/2 / sigma, b [..., m] the projected data."""
    A = jnp.eye(len(G), dtype=G.dtype) + half_prior[:, None] * G * half_prior[None, :]
    return A, (half_prior * b / noise).reshape(-1, len(G)).T


def _axis_pooled(G: Array, b: Array, log_s0: Array, log_s1: Array, noise: Array) -> Array:
    return evidence(*_scaled(G[0], b[0], jnp.exp(0.5 * log_s0) / noise, noise))


def _axis_balanced(G: Array, b: Array, log_s0: Array, log_s1: Array, noise: Array) -> Array:
    mean_prior = jnp.logaddexp(jnp.log(float(len(b))) + log_s0, log_s1)
    mean = evidence(*_scaled(G[0], b[0], jnp.exp(0.5 * mean_prior) / noise, noise))
    return mean + evidence(*_scaled(G[0], b[1:], jnp.exp(0.5 * log_s1) / noise, noise))


def _axis_gaps(G: Array, b: Array, log_s0: Array, log_s1: Array, noise: Array) -> Array:
    half = jnp.exp(0.5 * log_s1) / noise
    m = G.shape[-1]

    def one(
        total: tuple[Array, Array, Array], trial: tuple[Array, Array]
    ) -> tuple[tuple[Array, Array, Array], None]:
        G_r, b_r = trial
        A, r = _scaled(G_r, b_r, half, noise)
        right = half[:, None] * jnp.concatenate([G_r, b_r[:, None]], 1)
        solved = _solve(A, right)
        left = G_r * half[None, :]
        reduced = jnp.concatenate([G_r, b_r[:, None]], 1) - left @ solved
        value, M, projected = total
        return (value + evidence(A, r), M + reduced[:, :m], projected + reduced[:, m]), None

    start = (jnp.zeros(()), jnp.zeros((m, m)), jnp.zeros(m))
    (value, M, projected), _ = jax.lax.scan(one, start, (G, b))
    return value + evidence(*_scaled(M, projected, jnp.exp(0.5 * log_s0) / noise, noise))


@jax.custom_vjp
def _solve(A: Array, B: Array) -> Array:
    return _core_solve(A, B)


@jax.custom_batching.sequential_vmap
def _core_solve(A: Array, B: Array) -> Array:
    return jax.scipy.linalg.cho_solve((jnp.linalg.cholesky(A), True), B)


def _solve_forward(A, B):
    X = _core_solve(A, B)
    return X, (A, X)


def _solve_backward(saved, bar):
    A, X = saved
    back = _core_solve(A, bar)
    return -0.5 * (back @ X.T + X @ back.T), back


_solve.defvjp(_solve_forward, _solve_backward)

_AXIS = {"pooled": _axis_pooled, "balanced": _axis_balanced, "gaps": _axis_gaps}


def from_grams(
    effects: str, G: Array, b: Array, priors: tuple[Array, Array], noise: Array, rows: Rows
) -> Array:
    """Returns log p of the samples for any diagonal-prior features, from their Gram matrices.

    Args:
        effects: "pooled", "balanced" or "gaps", as in `Statistics`.
        G: [G, m, m]; b: [C, A, m], in the layout of `effects`.
        priors: log diag S_0 and log diag S_1, each [A, m].
        noise: [A], above 0.
        rows: for the sum of squares and the count.
    """

    def axis(each: tuple[Array, Array, Array, Array]) -> Array:
        return _AXIS[effects](G, *each)

    fitted = jax.lax.map(axis, (jnp.moveaxis(b, 1, 0), *priors, noise))
    rest = 0.5 * rows.square / noise**2 + 0.5 * rows.samples * jnp.log(2.0 * jnp.pi * noise**2)
    return jnp.sum(fitted - rest)


def unseen(frequency: ArrayLike, nyquist_hz: ArrayLike, harmonics: int) -> Array:
    """Returns what to add to a log prior [2 J + 1] so that harmonics above half the sample rate are left out.

    Samples cannot tell such a harmonic from its alias: kept, it would take a share of the alias's energy and
    show it at another frequency in draws at another time step.
    """
    orders = jnp.concatenate([jnp.arange(harmonics + 1), jnp.arange(1, harmonics + 1)])
    return jnp.where(orders * frequency > 1.001 * jnp.asarray(nyquist_hz), _NEVER, 0.0)


def bounded(log_prior: Array, log_constant: Array) -> Array:
    """Returns log priors [A, 2 J + 1] whose constant's variance stays below exp(log_constant) [A]."""
    first = log_prior[:, 0]
    return log_prior.at[:, 0].set(first - 0.5 * jnp.log1p(jnp.exp(2.0 * (first - log_constant))))


def log_likelihood(hyper: Hyper, rows: Rows, effects: str, harmonics: int, hidden: ArrayLike = 0.0) -> Array:
    """Returns log p of all samples on all axes (float64), in nats.

    Args:
        hyper: hyperparameters in the unit of the rows.
        rows: from `rows_of`.
        effects: "pooled", "balanced" or "gaps": the layout of the rows.
        harmonics: J.
        hidden: added to the log prior [2 J + 1], from `unseen`; 0: the kernel as it is.
    """
    G, b = grams(hyper.frequency_hz, rows, harmonics)
    common = own = bounded(log_prior(hyper.length, hyper.amplitude, harmonics), rows.log_constant[0]) + hidden
    if effects != "pooled":
        own = log_prior(hyper.trial_length, hyper.trial_amplitude, harmonics)
        own = bounded(own, rows.log_constant[1]) + hidden
    return from_grams(effects, G, b, (common, own), hyper.noise, rows)
