"""How well the trials fix the hyperparameters: the Laplace approximation at the optimum.

The Hessian of minus the log likelihood is formed by central differences of its exact gradient (float64, so
good to about 1e-7 of its size) and inverted; a direction that the trials do not fix has an infinite error.

Breaks when the noise is coloured: the period's error is then too small. `inflation` is the usual factor for
noise with the lag-1 autocorrelation rho; report it beside the error.
"""

from __future__ import annotations

import functools
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from mjx_cutting import _platform
from mjx_cutting.disturbance.kernel import shortest_length
from mjx_cutting.disturbance.search import Found, objective, rows_of
from mjx_cutting.disturbance.statistics import Statistics

_STEP = 1e-4


def hessian(
    found: Found, statistics: Statistics, harmonics: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the Hessian [P, P] and the gradient [P] of minus the log likelihood at the search's optimum."""
    x, n = found.variables, len(found.variables)
    points = np.concatenate([x + _STEP * np.eye(n), x - _STEP * np.eye(n)])
    fixed = (
        jnp.asarray(found.start_hz),
        jnp.asarray(found.reach_hz),
        jnp.asarray(shortest_length(harmonics)),
        rows_of(statistics, constants=True),
    )
    gradient = _gradient(statistics.effects, harmonics)
    slopes = np.stack([np.asarray(gradient(jnp.asarray(point), *fixed)[1]) for point in points])
    full = (slopes[:n] - slopes[n:]) / (2.0 * _STEP)
    return 0.5 * (full + full.T), slopes.mean(0)


@functools.lru_cache
def _gradient(effects: str, harmonics: int) -> Any:
    return _platform.jit(objective(effects, harmonics)[1])


def standard_errors(found: Found, statistics: Statistics, harmonics: int) -> dict[str, Any]:
    """Returns standard errors: frequency_hz, period_s, and lists over axes of relative errors.

    inf where the trials do not fix a direction (a process whose amplitude went to zero, say). "gain_nats" is
    what a Newton step from the optimum would still gain: far below 1 where the search has converged; "unit"
    is |diag H|^-1/2 in the search's variables, for another search from there.
    """
    H, gradient = hessian(found, statistics, harmonics)
    scale = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(H)), 1e-3))
    value, vector = np.linalg.eigh(scale[:, None] * H * scale)
    along = vector.T @ (scale * gradient)
    gain = float(np.sum(0.5 * along**2 / np.maximum(np.abs(value), 1e-2)))
    spread = np.where(value > 1e-9, 1.0 / np.maximum(value, 1e-9), np.inf)
    loaded = vector**2 > 1e-12
    variance = np.array([np.sum(v[k] ** 2 * spread[k]) for v, k in zip(vector, loaded, strict=True)])
    errors = np.sqrt(variance) * scale
    axes = statistics.axes
    slope = (1.0 - np.tanh(found.variables[0]) ** 2) * found.reach_hz
    frequency = float(errors[0] * slope) if np.isfinite(errors[0]) else float("inf")
    names = ["length", "amplitude_n"]
    if statistics.effects != "pooled":
        names += ["trial_length", "trial_amplitude_n"]
    names += ["noise_std_n"]
    result: dict[str, Any] = {
        "frequency_hz": frequency,
        "period_s": frequency / float(found.hyper.frequency_hz) ** 2,
        "gain_nats": gain,
        "unit": scale.tolist(),
    }
    for i, name in enumerate(names):
        result[f"{name}_relative"] = errors[1 + i * axes : 1 + (i + 1) * axes].tolist()
    return result


def inflation(lag1: float) -> float:
    """Returns sqrt((1 + rho) / (1 - rho)): how much noise of lag-1 autocorrelation rho widens an error."""
    rho = float(np.clip(lag1, 0.0, 0.999))
    return float(np.sqrt((1.0 + rho) / (1.0 - rho)))
