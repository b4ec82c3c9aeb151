"""Trials drawn from the model itself, and the dense answer to compare with."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import linalg

from mjx_cutting import _platform
from mjx_cutting.disturbance.kernel import fourier, prior


@pytest.fixture
def x64():
    """float64 for one test."""
    with _platform.x64():
        yield


def _periodic(t, u, length, amplitude, frequency):
    sine = np.sin(np.pi * (np.asarray(t)[:, None] - np.asarray(u)[None, :]) * frequency)
    return amplitude**2 * np.exp(-2.0 * sine**2 / length**2)


@pytest.fixture(scope="session")
def periodic():
    """The kernel in closed form [n, k]."""
    return _periodic


def _simulate(
    seed,
    *,
    trials=14,
    stamps=2500,
    rate_hz=500.0,
    frequency_hz=2.13,
    length=0.5,
    amplitude=1.0,
    trial_length=0.6,
    trial_amplitude=0.5,
    noise=0.6,
    axes=3,
):
    rng = np.random.default_rng(seed)
    time = np.arange(stamps) / rate_hz
    phi = fourier(time, frequency_hz, 32)
    g = rng.normal(size=(axes, 65)) * np.sqrt(prior(length, 32)) * amplitude
    h = rng.normal(size=(trials, axes, 65)) * np.sqrt(prior(trial_length, 32)) * trial_amplitude
    latent = np.einsum("nm,ram->rna", phi, g + h)
    residual = latent + noise * rng.normal(size=latent.shape)
    fresh = rng.normal(size=(axes, 65)) * np.sqrt(prior(trial_length, 32)) * trial_amplitude
    return SimpleNamespace(
        time_s=time,
        residual_n=residual,
        latent_n=latent,
        common_n=phi @ g.T,
        new_trial_n=phi @ (g + fresh).T,
        frequency_hz=frequency_hz,
    )


@pytest.fixture(scope="session")
def simulate():
    """Draws trials of known hyperparameters: see the keyword arguments."""
    return _simulate


def _dense_log_likelihood(hyper, statistics):
    total, t = 0.0, statistics.time_s
    for a in range(statistics.axes):
        y = statistics.residual[..., a]
        seen = np.isfinite(y)
        stamps = np.broadcast_to(t, y.shape)[seen]
        trial = np.broadcast_to(np.arange(len(y))[:, None], y.shape)[seen]
        frequency = hyper.frequency_hz
        K = _periodic(stamps, stamps, hyper.length[a], hyper.amplitude[a], frequency)
        if statistics.effects != "pooled":
            own = _periodic(stamps, stamps, hyper.trial_length[a], hyper.trial_amplitude[a], frequency)
            K += own * (trial[:, None] == trial[None, :])
        K += hyper.noise[a] ** 2 * np.eye(len(stamps))
        factor = linalg.cho_factor(K, lower=True)
        total -= 0.5 * y[seen] @ linalg.cho_solve(factor, y[seen])
        total -= np.sum(np.log(np.diag(factor[0]))) + 0.5 * len(stamps) * np.log(2 * np.pi)
    return total


@pytest.fixture(scope="session")
def dense_log_likelihood():
    """The log likelihood through the full covariance matrix: O(n^3), no reduction of any kind."""
    return _dense_log_likelihood
