"""The sufficient-statistics likelihood against the full covariance, for all layouts of trials."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tinygp

from mjx_cutting import _platform
from mjx_cutting.disturbance import kernel, likelihood, search, statistics
from mjx_cutting.disturbance.kernel import fourier

HYPER = likelihood.Hyper(
    3.1,
    np.array([0.5, 0.6, 1.2]),
    np.array([1.0, 0.5, 2.0]),
    np.array([0.7, 0.5, 0.8]),
    np.array([0.3, 0.2, 0.5]),
    np.array([0.5, 0.7, 0.2]),
)


def _trials(gaps):
    rng = np.random.default_rng(0)
    time = np.arange(120) * 0.01
    residual = rng.normal(size=(5, 120, 3)) + np.sin(2 * np.pi * 3.1 * time)[None, :, None]
    if gaps:
        residual[1, 90:] = np.nan
        residual[3, :7] = np.nan
        residual[:, 50] = np.nan
    return time, residual


@pytest.mark.parametrize(
    ("gaps", "effects", "layout"),
    [(False, False, "pooled"), (True, False, "pooled"), (False, True, "balanced"), (True, True, "gaps")],
)
def test_value_and_gradient_against_dense(x64, dense_log_likelihood, gaps, effects, layout):
    reduced = statistics.reduce(*_trials(gaps), effects)
    assert reduced.effects == layout
    hyper = jax.tree.map(jnp.asarray, HYPER)
    rows = search.rows_of(reduced)
    value, slope = _platform.jit(
        jax.value_and_grad(lambda h: likelihood.log_likelihood(h, rows, layout, 32))
    )(hyper)
    assert abs(value - dense_log_likelihood(HYPER, reduced)) < 1e-6
    for name in HYPER._fields:
        if layout == "pooled" and name.startswith("trial"):
            continue
        at, by = np.asarray(getattr(HYPER, name), float), np.asarray(getattr(slope, name))
        for where in np.ndindex(at.shape):
            numeric = 0.0
            for sign in (1, -1):
                moved = at.copy()
                moved[where] += sign * 1e-5
                numeric += sign * dense_log_likelihood(HYPER._replace(**{name: moved}), reduced) / 2e-5
            assert by[where] == pytest.approx(numeric, rel=2e-6, abs=2e-5), (name, where)


@pytest.mark.parametrize("count", [50, pytest.param(250, marks=pytest.mark.slow)])
def test_replicated_stamps_against_dense_tinygp(x64, count):
    # 14 trials as one process; with 250 stamps about the largest that a dense answer is still to be had for
    rng = np.random.default_rng(3)
    time = np.arange(count) * (5.0 / count)
    residual = np.sin(2 * np.pi * 2.1 * time)[None, :, None] + 0.4 * rng.normal(size=(14, count, 1))
    reduced = statistics.reduce(time, residual, False)
    rows = search.rows_of(reduced)

    def ours(p):
        hyper = likelihood.Hyper(p[0], p[1:2], p[2:3], p[1:2], p[2:3], p[3:4])
        return likelihood.log_likelihood(hyper, rows, "pooled", 32)

    stamps = jnp.asarray(np.tile(reduced.time_s, 14))
    y = jnp.asarray(reduced.residual[..., 0].ravel())

    def dense(p):
        kernel = p[2] ** 2 * tinygp.kernels.ExpSineSquared(scale=1 / p[0], gamma=2 / p[1] ** 2)
        return tinygp.GaussianProcess(kernel, stamps, diag=p[3] ** 2).log_probability(y)

    at = jnp.asarray([2.1, 0.7, 0.9, 0.5])
    value, slope = _platform.jit(jax.value_and_grad(ours))(at)
    true, true_slope = _platform.jit(jax.value_and_grad(dense))(at)
    assert abs(value - true) < 1e-6
    np.testing.assert_allclose(slope, true_slope, rtol=1e-8)


def test_grams_are_products_of_features(x64):
    time, residual = _trials(True)
    reduced = statistics.reduce(time, residual, True)
    G, b = _platform.jit(likelihood.grams, static_argnums=2)(jnp.asarray(3.1), search.rows_of(reduced), 16)
    phi = fourier(reduced.time_s, 3.1, 16)
    for r in range(5):
        np.testing.assert_allclose(G[r], (phi * reduced.weights[r][:, None]).T @ phi, atol=1e-11)
        np.testing.assert_allclose(b[r, 2], reduced.sums[r, 2] @ phi, atol=1e-11)


def test_float32_is_not_enough(x64):
    # the precision policy: what a float32 likelihood loses at small noise is nats, not digits
    reduced = statistics.reduce(*_trials(False), False)
    rows = search.rows_of(reduced)
    evaluate = _platform.jit(likelihood.log_likelihood, static_argnums=(2, 3))
    lost = []
    for noise in (0.01, 0.014, 0.02, 0.028):
        hyper = jax.tree.map(jnp.asarray, HYPER._replace(noise=np.full(3, noise)))
        single = jax.tree.map(lambda v: v.astype(jnp.float32), (hyper, rows))
        lost.append(float(evaluate(*single, "pooled", 32)) - float(evaluate(hyper, rows, "pooled", 32)))
    assert np.max(np.abs(lost)) > 0.1


def test_vmapped_objective_equals_a_loop(x64):
    reduced = statistics.reduce(*_trials(False), True)
    smooth, gradient = search.objective("balanced", 32)
    one = np.ones(3)
    x = np.stack([search.encode(l * one, one, 0.5 * one, (one, 0.3 * one)) for l in (0.4, 0.8, 1.5)])
    fixed = (jnp.asarray(3.0), jnp.asarray(0.8), jnp.asarray(0.2), search.rows_of(reduced))
    axes = (0, None, None, None, None)
    together = _platform.jit(jax.vmap(jax.value_and_grad(smooth), axes))(jnp.asarray(x), *fixed)
    alone = _platform.jit(gradient)
    for i in range(3):
        value, slope = alone(jnp.asarray(x[i]), *fixed)
        np.testing.assert_allclose(together[0][i], value, rtol=1e-12)
        np.testing.assert_allclose(together[1][i], slope, rtol=1e-9, atol=1e-9)


def test_long_records_are_summed_in_blocks_without_loss(x64):
    rng = np.random.default_rng(8)
    time = np.sort(rng.uniform(0.0, 5.0, 2 * likelihood._BLOCK + 617))
    reduced = statistics.reduce(time, rng.normal(size=(2, len(time), 1)))
    rows = search.rows_of(reduced)
    G, b = likelihood.grams(jnp.asarray(3.1), rows, 12)
    phi = fourier(time, 3.1, 12)
    np.testing.assert_allclose(G[0], phi.T @ phi, atol=1e-9 * len(time))
    np.testing.assert_allclose(b[1, 0], phi.T @ reduced.sums[1, 0], atol=1e-8)

    def total(frequency):
        G, b = likelihood.grams(frequency, rows, 12)
        return jnp.sum(jnp.tanh(G / len(time))) + jnp.sum(b**2)

    slope = jax.grad(total)(jnp.asarray(3.1))
    near = [float(total(jnp.asarray(3.1 + step))) for step in (1e-6, -1e-6)]
    assert float(slope) == pytest.approx((near[0] - near[1]) / 2e-6, rel=1e-5)


def test_the_bound_on_constants_is_one_on_host_and_in_graph(x64):
    length, amplitude, most = np.array([0.5, 20.0]), np.array([1.0, 40.0]), np.array([[0.3, 2.0], [9.0, 0.1]])
    hyper = likelihood.Hyper(2.0, length, amplitude, length, amplitude, np.ones(2))
    host = search.prior_variances(hyper, 16, 16, most)
    for variances, bound in zip(host, most, strict=True):
        logs = likelihood.bounded(kernel.log_prior(jnp.asarray(length), jnp.asarray(amplitude), 16),
                                  2.0 * jnp.log(jnp.asarray(bound)))  # fmt: skip
        np.testing.assert_allclose(np.exp(logs), variances, rtol=1e-9, atol=1e-300)
        assert np.all(variances[:, 0] <= bound**2)
    free = search.prior_variances(hyper, 16, 16, np.full((2, 2), 1e3))
    np.testing.assert_allclose(free[0][0, 0], kernel.prior(0.5, 16)[0], rtol=1e-9)
