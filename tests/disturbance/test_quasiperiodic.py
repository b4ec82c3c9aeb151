"""The drifting option: its kernel, its fit, and the simulation's form of it."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tinygp

import mjx_cutting.disturbance as disturbance
from mjx_cutting.disturbance import quasiperiodic
from mjx_cutting.disturbance.solver import FiniteRankSolver


@pytest.mark.parametrize("slow", [0.25, 0.6, 20.0])
def test_finite_rank_against_dense_tinygp(x64, slow):
    window = 3.0
    nodes = jnp.asarray(quasiperiodic.chebyshev_nodes(0.0, window, quasiperiodic.NODES))
    t = jnp.linspace(0.0, window, 120)
    y = jnp.sin(2 * jnp.pi * t / 0.4) * jnp.exp(-t / 2)
    kernel = quasiperiodic.QuasiPeriodicKernel(0.4, 0.9, 1.2, slow * window, nodes, 16)
    ours = tinygp.GaussianProcess(kernel, t, diag=0.05, solver=FiniteRankSolver)
    periodic = tinygp.kernels.ExpSineSquared(scale=0.4, gamma=2 / 0.9**2)
    dense = tinygp.GaussianProcess(1.44 * periodic * tinygp.kernels.ExpSquared(slow * window), t, diag=0.05)
    np.testing.assert_allclose(ours.log_probability(y), dense.log_probability(y), atol=1e-5)
    np.testing.assert_allclose(kernel(t, t), dense.kernel(t, t), atol=1e-12)


@pytest.fixture(scope="module")
def drifting():
    rng = np.random.default_rng(0)
    t = np.arange(400) * 0.01
    apart = t[:, None] - t[None, :]
    K = np.exp(-2 * np.sin(np.pi * apart * 2.13) ** 2 / 0.8**2 - 0.5 * (apart / 2.0) ** 2)
    root = np.linalg.cholesky(K + 1e-9 * np.eye(400))
    residual = (root @ rng.normal(size=400))[None] + 0.2 * rng.normal(size=(4, 400))
    options = {"trial_effects": False, "diagnose": False, "frequency_range_hz": (1.0, 4.0)}
    return (
        t,
        residual,
        {
            kind: disturbance.fit(t, residual[..., None], quasi_periodic=kind, **options)
            for kind in (False, True)
        },
    )


def test_fit_finds_the_drift_and_beats_the_periodic_process(drifting):
    _, _, gps = drifting
    gp = gps[True]
    assert gp.log_likelihood > gps[False].log_likelihood + 100
    assert 0.8 < gp.slow_length_s < 4.5  # drawn with 2
    assert gp.frequency_hz == pytest.approx(2.13, abs=0.05)
    np.testing.assert_allclose(gp.noise_std_n, 0.2, rtol=0.06)


def test_draws_follow_the_mean_then_run_back(drifting, tmp_path):
    t, _, gps = drifting
    gp = disturbance.load(gps[True].save(tmp_path / "d.npz"))
    posterior = gp.posterior()
    draw = posterior.draw(jax.random.key(0), "mean", random_phase=False)

    def step(d, _):
        return posterior.advance(d, 0.01), posterior.value(d)

    _, run = jax.jit(lambda d: jax.lax.scan(step, d, None, length=900))(draw)
    mean, spread = gp.predict(t)
    np.testing.assert_allclose(run[:400, 0], mean[:, 0], atol=2e-3)
    assert float(jnp.max(jnp.abs(run))) < 2.0 * np.abs(mean).max()  # never leaves what was seen
    draws = jax.vmap(lambda k: posterior.draw(k, random_phase=False))(
        jax.random.split(jax.random.key(1), 3000)
    )
    start = np.asarray(jax.vmap(posterior.value)(draws))[:, 0]
    assert start.std() == pytest.approx(spread[0, 0], rel=0.1)
    noisy = posterior.value(draw, jax.random.key(0))
    assert float(noisy[0]) != float(posterior.value(draw)[0]) and float(noisy[1]) == 0.0


@pytest.mark.slow
def test_a_steady_shape_says_that_drift_gains_nothing(simulate):
    drawn = simulate(1, trials=3, stamps=300, rate_hz=100.0, axes=1, length=0.9, trial_amplitude=0.0)
    gp = disturbance.fit(
        drawn.time_s,
        drawn.residual_n,
        quasi_periodic=True,
        trial_effects=False,
        diagnose=False,
        frequency_range_hz=(1.0, 4.0),
    )
    assert any("plain periodic" in w for w in gp.warnings)
