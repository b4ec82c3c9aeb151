"""The search for the hyperparameters: exact likelihood on a grid of frequencies, then BFGS from its peaks.

Random periods as starting points fail: the likelihood has a peak of width 1/T at every alias and multiple
of the period. So (a) the likelihood of the pooled trials is evaluated on frequencies spaced 1/(16 T) for
three lengths, exactly; (b) its best local maxima start `optimistix.BFGS`, vmapped, in the variables
(arctanh of (f - f0) / reach, log lengths, log amplitudes, log noise) scaled by |diag H|^-1/2; (c) the best
finite ones start the search with trial effects. A frequency stays within its reach, at most 1/T, of its
start and (to within a sixteenth of that) in the range looked at, hence above 0.

Breaks when the noise is coloured: a peak is still found, but its height and width are wrong (see
`diagnostics`).
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jax import Array
from numpy.typing import NDArray

from mjx_cutting import _platform
from mjx_cutting.disturbance.kernel import log_prior, prior, shortest_length
from mjx_cutting.disturbance.likelihood import Hyper, Rows, from_grams, grams, log_likelihood, unseen
from mjx_cutting.disturbance.statistics import Statistics

SCAN_LENGTHS = (0.25, 0.6, 1.2)
GRID_PER_SPAN = 16
STEPS = 60
TOLERANCE = 1e-5
_LEAST_NOISE = 1e-5  # of an axis's spread: below it the samples count as noise-free
_LEAST_AMPLITUDE = 1e-6  # of an axis's spread: below it a process counts as absent
_CHUNK = 128  # frequencies scanned by one call
_LONGEST = 30.0  # l: beyond it the kernel is a constant and one cosine, and only s / l counts
_UNBOUNDED = 300.0  # logarithm of a variance that bounds nothing
_SCAN_NOISE = 0.05  # of an axis's spread: keeps the peaks of nearly noise-free data wider than the grid


@dataclass(frozen=True)
class Found:
    """What a search returns, in the scaled unit of its `Statistics`."""

    hyper: Hyper  # NumPy arrays
    log_likelihood: float
    variables: NDArray[np.float64]  # [P] the optimum in the search's unscaled variables
    start_hz: float  # f0 of those variables
    reach_hz: float  # how far from it the frequency may go
    converged: bool  # the best start met the tolerance
    tried: int
    finite: int


def rows_of(statistics: Statistics, constants: bool = False) -> Rows:
    """Returns the arrays the likelihood reads (to be called with float64 switched on).

    Args:
        statistics: the trials.
        constants: bound the constants of the processes by `Statistics.largest_constant`, as the search does;
            without, the kernel is as it is written.
    """
    s = statistics
    most = 2.0 * np.log(s.largest_constant) if constants else np.full((2, s.axes), _UNBOUNDED)
    rows = (s.time_s, s.weights, s.sums, s.square, float(s.count), s.nyquist_hz, most)
    return Rows(*(jnp.asarray(a, jnp.float64) for a in rows))


def frequency_grid(statistics: Statistics, low_hz: float, high_hz: float) -> NDArray[np.float64]:
    """Returns frequencies [F], Hz, from low to high, spaced 1 / (16 T)."""
    step = 1.0 / (GRID_PER_SPAN * statistics.span_s)
    count = int(np.floor((high_hz - low_hz) / step)) + 1
    return np.asarray(low_hz + step * np.arange(count), np.float64)


@functools.partial(_platform.jit, static_argnames="harmonics")
def _scan(frequencies: Array, lengths: Array, noise: Array, rows: Rows, harmonics: int) -> Array:
    axes = noise.shape[0]
    priors = log_prior(jnp.broadcast_to(lengths[:, None], (len(lengths), axes)), 1.0, harmonics)

    def one(frequency: Array) -> Array:
        G, b = grams(frequency, rows, harmonics)
        hidden = unseen(frequency, rows.nyquist_hz, harmonics)

        def with_length(prior: Array) -> Array:
            return from_grams("pooled", G, b, (prior + hidden, prior + hidden), noise, rows)

        return jax.lax.map(with_length, priors)

    return jax.lax.map(one, frequencies)


def scan(pooled: Statistics, frequencies: NDArray, noise: NDArray, harmonics: int) -> NDArray[np.float64]:
    """Returns the log likelihood [F, 3] of the pooled trials at the frequencies [Hz] and `SCAN_LENGTHS`."""
    fixed = (jnp.asarray(SCAN_LENGTHS), jnp.asarray(np.maximum(noise, _SCAN_NOISE)), rows_of(pooled))
    parts = []
    for start in range(0, len(frequencies), _CHUNK):  # of one size, so that any grid compiles once
        part = frequencies[start : start + _CHUNK]
        padded = np.concatenate([part, np.full(_CHUNK - len(part), part[-1])])
        parts.append(np.asarray(_scan(jnp.asarray(padded), *fixed, harmonics))[: len(part)])
    return np.concatenate(parts)


def peaks(frequencies: NDArray, scanned: NDArray, count: int) -> tuple[NDArray, NDArray]:
    """Returns (frequency [count], length [count]) of the best local maxima, the best first.

    Where there are fewer maxima the best is started again from the other lengths.
    """
    profile = np.where(np.isfinite(scanned), scanned, -np.inf).max(1)
    padded = np.concatenate([[-np.inf], profile, [-np.inf]])
    inner = (padded[1:-1] >= padded[:-2]) & (padded[1:-1] > padded[2:])
    found = np.flatnonzero(inner)
    found = found[np.argsort(-profile[found])][:count]
    lengths = np.asarray(SCAN_LENGTHS)
    f, length = list(frequencies[found]), list(lengths[np.argmax(scanned[found], axis=1)])
    extra = 0
    while len(f) < count:
        f.append(frequencies[found[(extra // 3) % len(found)]])
        length.append(lengths[extra % 3])
        extra += 1
    return np.asarray(f), np.asarray(length)


def encode(
    length: NDArray, amplitude: NDArray, noise: NDArray, own: tuple[NDArray, NDArray] | None
) -> NDArray:
    """Returns the search's variables [P] at their start frequency from [A] each (`own`: trial effects)."""
    blocks = [np.zeros(1), np.log(length), np.log(amplitude)]
    if own is not None:
        blocks += [np.log(own[0]), np.log(own[1])]
    return np.concatenate([*blocks, np.log(noise)])


def decode(x: Array, start_hz: Array, reach_hz: Array, shortest: Array, effects: str) -> Hyper:
    """Returns the hyperparameters of variables x [P], all within their bounds."""
    own = effects != "pooled"
    axes = (x.shape[0] - 1) // (5 if own else 3)
    parts = [x[1 + i * axes : 1 + (i + 1) * axes] for i in range(5 if own else 3)]
    frequency = start_hz + reach_hz * jnp.tanh(x[0])

    def bounded(log_length: Array) -> Array:
        return jnp.sqrt(shortest**2 + 1.0 / (_LONGEST**-2 + jnp.exp(-2.0 * log_length)))

    def above(log_value: Array, least: float) -> Array:
        return jnp.sqrt(least**2 + jnp.exp(2.0 * log_value))

    length, amplitude = bounded(parts[0]), above(parts[1], _LEAST_AMPLITUDE)
    own_length, own_amplitude = length, 0.0 * amplitude
    if own:
        own_length, own_amplitude = bounded(parts[2]), above(parts[3], _LEAST_AMPLITUDE)
    noise = above(parts[-1], _LEAST_NOISE)
    return Hyper(frequency, length, amplitude, own_length, own_amplitude, noise)


def visible_harmonics(start_hz: float, nyquist_hz: float, harmonics: int) -> int:
    """Returns how many of the harmonics lie below half the sample rate (as `likelihood.unseen` counts)."""
    return int(np.sum(np.arange(1, harmonics + 1) * start_hz <= 1.001 * nyquist_hz))


def prior_variances(
    hyper: Hyper, harmonics: int, visible: int, constant: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns diag S_0 and diag S_1, each [A, 2 J + 1], with the harmonics above `visible` left out and the
    constants' deviations bounded by `constant` [2, A], as in `likelihood.bounded`."""
    orders = np.concatenate([np.arange(harmonics + 1), np.arange(1, harmonics + 1)])
    seen = orders <= visible
    common = zip(hyper.length, hyper.amplitude, strict=True)
    own = zip(hyper.trial_length, hyper.trial_amplitude, strict=True)
    both = [np.stack([s**2 * prior(l, harmonics) * seen for l, s in each]) for each in (common, own)]
    for variances, most in zip(both, constant, strict=True):
        variances[:, 0] /= np.sqrt(1.0 + (variances[:, 0] / most**2) ** 2)
    return both[0], both[1]


@functools.lru_cache
def objective(effects: str, harmonics: int) -> tuple[Callable, Callable]:
    """Returns (f, g): minus the log likelihood of (x, start_hz, reach_hz, shortest, rows), and its value and
    gradient. Both may be vmapped: the evaluations then run one after another."""

    def raw(x, start_hz, reach_hz, shortest, rows):
        hidden = unseen(start_hz, rows.nyquist_hz, harmonics)
        hyper = decode(x, start_hz, reach_hz, shortest, effects)
        return -log_likelihood(hyper, rows, effects, harmonics, hidden)

    value = jax.custom_batching.sequential_vmap(raw)
    gradient = jax.custom_batching.sequential_vmap(jax.value_and_grad(raw))

    @jax.custom_jvp
    def smooth(x, start_hz, reach_hz, shortest, rows):
        return value(x, start_hz, reach_hz, shortest, rows)

    @smooth.defjvp
    def _(primals, tangents):
        found, slope = gradient(*primals)
        return found, slope @ tangents[0]

    return smooth, gradient


@functools.partial(_platform.jit, static_argnames=("effects", "harmonics", "steps"))
def _minimise(
    x0: Array,
    unit: Array,
    start_hz: Array,
    reach_hz: Array,
    shortest: Array,
    rows: Rows,
    effects: str,
    harmonics: int,
    steps: int,
) -> tuple[Array, Array, Array]:
    smooth, _ = objective(effects, harmonics)
    solver = optimistix.BFGS(TOLERANCE, TOLERANCE)

    def one(x, u, f0, reach):
        def scaled(y, _):
            return smooth(x + u * y, f0, reach, shortest, rows)

        solution = optimistix.minimise(scaled, solver, jnp.zeros_like(x), max_steps=steps, throw=False)
        good = solution.result == optimistix.RESULTS.successful
        return x + u * solution.value, solution.state.f_info.f, good

    return jax.vmap(one)(x0, unit, start_hz, reach_hz)


def units(statistics: Statistics, x0: NDArray, curvature: NDArray) -> NDArray[np.float64]:
    """Returns |diag H|^-1/2 [K, P] as known beforehand: the frequency's from the scan, 2 n of a log noise,
    2 per harmonic pair that matters of a log amplitude or length (some ten, times R for a trial's own)."""
    own = statistics.effects != "pooled"
    axes = (x0.shape[1] - 1) // (5 if own else 3)
    blocks = [20.0, 40.0] + ([40.0 * statistics.trials, 20.0 * statistics.trials] if own else [])
    blocks += [2.0 * statistics.count]
    diagonal = np.repeat(blocks, axes)
    diagonal = np.concatenate([curvature[:, None], np.broadcast_to(diagonal, (len(x0), len(diagonal)))], 1)
    return 1.0 / np.sqrt(np.maximum(diagonal, 1.0))


def scan_curvature(frequencies: NDArray, scanned: NDArray, at: NDArray) -> NDArray[np.float64]:
    """Returns minus the second difference of the scan's profile at frequencies `at` [K], per (1/T)^2."""
    profile = np.where(np.isfinite(scanned), scanned, np.min(scanned[np.isfinite(scanned)])).max(1)
    i = np.clip(np.searchsorted(frequencies, at), 1, len(frequencies) - 2)
    return np.maximum(2 * profile[i] - profile[i - 1] - profile[i + 1], 1.0) * GRID_PER_SPAN**2


def minimise(
    statistics: Statistics,
    x0: NDArray,
    start_hz: NDArray,
    curvature: NDArray,
    harmonics: int,
    low_hz: float,
    steps: int = STEPS,
    unit: NDArray | None = None,
) -> list[Found]:
    """Returns the outcome of every start, the best first; those that are not finite are left out.

    Args:
        statistics: the trials.
        x0: starts [K, P] in the variables of `encode`.
        start_hz: their frequencies [K], Hz.
        curvature: of minus the log likelihood by frequency times T [K], from `scan_curvature`.
        harmonics: J.
        low_hz: the least frequency looked at, Hz.
        steps: the most BFGS steps.
        unit: |diag H|^-1/2 [P] where it is known; default from `units`.
    """
    shortest = shortest_length(harmonics)
    span = statistics.span_s
    reach = np.clip(start_hz - low_hz, 1.0 / (GRID_PER_SPAN * span), 1.0 / span)
    curvature = curvature * (reach * span) ** 2
    ends, values, good = _minimise(
        jnp.asarray(x0),
        jnp.asarray(units(statistics, x0, curvature) if unit is None else np.broadcast_to(unit, x0.shape)),
        jnp.asarray(start_hz),
        jnp.asarray(reach),
        jnp.asarray(shortest),
        rows_of(statistics, constants=True),
        statistics.effects,
        harmonics,
        steps,
    )
    ends, values, good = np.asarray(ends), np.asarray(values), np.asarray(good)
    finite = np.isfinite(values) & np.isfinite(ends).all(1)
    order = [i for i in np.argsort(np.where(finite, values, np.inf)) if finite[i]]
    found = []
    for i in order:
        x, f0, near, least = (jnp.asarray(v) for v in (ends[i], start_hz[i], reach[i], shortest))
        hyper = decode(x, f0, near, least, statistics.effects)
        found.append(
            Found(
                Hyper(*(np.asarray(v, np.float64) for v in hyper)),
                -float(values[i]),
                ends[i],
                float(start_hz[i]),
                float(reach[i]),
                bool(good[i]),
                len(values),
                int(finite.sum()),
            )
        )
    return found
