"""The tinygp solver against tinygp's dense one: value, gradient, mean, variance, square root."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tinygp

from mjx_cutting import _platform
from mjx_cutting.disturbance.kernel import PeriodicKernel
from mjx_cutting.disturbance.solver import FiniteRankSolver, predict

HYPER = jnp.asarray  # period, length, amplitude, noise, in that order


def _times(n):
    return np.sort(np.random.default_rng(n).uniform(0, 5, n))


def _data(t, seed=1):
    rng = np.random.default_rng(seed)
    return np.sin(2 * np.pi * t / 0.47) + 0.4 * np.cos(4 * np.pi * t / 0.47) + 0.3 * rng.normal(size=t.shape)


def _ours(theta, t):
    kernel = PeriodicKernel(theta[0], theta[1], theta[2])
    return tinygp.GaussianProcess(kernel, t, diag=theta[3] ** 2, solver=FiniteRankSolver)


def _dense(theta, t):
    kernel = theta[2] ** 2 * tinygp.kernels.ExpSineSquared(scale=theta[0], gamma=2 / theta[1] ** 2)
    return tinygp.GaussianProcess(kernel, t, diag=theta[3] ** 2)


THETA = np.array([0.47, 0.6, 1.3, 0.3])


@pytest.mark.parametrize("n", [50, 1000])
def test_value_gradient_mean_variance_against_dense(x64, n):
    t = _times(n)
    y, theta, test = jnp.asarray(_data(t)), jnp.asarray(THETA), jnp.linspace(-1, 8, 37)
    value, slope = _platform.jit(jax.value_and_grad(lambda p: _ours(p, t).log_probability(y)))(theta)
    true, true_slope = _platform.jit(jax.value_and_grad(lambda p: _dense(p, t).log_probability(y)))(theta)
    assert abs(value - true) < 1e-6
    np.testing.assert_allclose(slope, true_slope, rtol=1e-8)
    ours, dense = _ours(theta, t), _dense(theta, t)
    got, expected = (gp.condition(y, test, diag=jnp.asarray(1e-12)).gp for gp in (ours, dense))
    np.testing.assert_allclose(got.loc, expected.loc, atol=1e-8)
    np.testing.assert_allclose(got.variance, expected.variance, rtol=1e-7)
    np.testing.assert_allclose(got.covariance, expected.covariance, atol=1e-10)
    mean, variance = predict(ours, y, test)
    np.testing.assert_allclose(mean, expected.loc, atol=1e-8)
    np.testing.assert_allclose(variance + 1e-12, expected.variance, rtol=1e-7)


def test_square_root_and_solves(x64):
    t = _times(120)
    diag = jnp.linspace(0.05, 0.4, 120)
    kernel = PeriodicKernel(0.47, 0.5, 1.3)
    gp = tinygp.GaussianProcess(kernel, jnp.asarray(t), diag=diag, solver=FiniteRankSolver)
    K = np.asarray(kernel(t, t)) + np.diag(diag)
    root = np.asarray(gp.solver.dot_triangular(jnp.eye(120)))
    np.testing.assert_allclose(root @ root.T, K, atol=1e-9 * np.abs(K).max())
    np.testing.assert_allclose(gp.solver.solve_triangular(root), np.eye(120), atol=1e-9)
    np.testing.assert_allclose(gp.solver.solve_triangular(root.T, transpose=True), np.eye(120), atol=1e-9)
    np.testing.assert_allclose(gp.covariance, K, atol=1e-12)
    np.testing.assert_allclose(gp.variance, np.diag(K), atol=1e-12)
    np.testing.assert_allclose(2 * gp.solver.normalization(), np.linalg.slogdet(2 * np.pi * K)[1], atol=1e-8)


def test_condition_on_the_training_points_and_with_another_kernel(x64):
    t = _times(60)
    y, theta = jnp.asarray(_data(t)), jnp.asarray(THETA)
    ours, dense = _ours(theta, t), _dense(theta, t)
    np.testing.assert_allclose(ours.condition(y).gp.loc, dense.condition(y).gp.loc, atol=1e-9)
    part = 0.5 * tinygp.kernels.ExpSineSquared(scale=0.47, gamma=3.0)
    test = jnp.linspace(0, 3, 11)
    got = ours.condition(y, test, kernel=part, diag=jnp.asarray(0.1)).gp
    expected = dense.condition(y, test, kernel=part, diag=jnp.asarray(0.1)).gp
    np.testing.assert_allclose(got.loc, expected.loc, atol=1e-9)
    np.testing.assert_allclose(got.covariance, expected.covariance, atol=1e-9)


def test_takes_tinygps_own_periodic_kernel_and_a_mean(x64):
    t = jnp.asarray(_times(80))
    y = jnp.asarray(_data(np.asarray(t))) + 5.0
    kernel = 1.2 * tinygp.kernels.ExpSineSquared(scale=0.47, gamma=4.0)
    ours = tinygp.GaussianProcess(kernel, t, diag=0.1, mean=5.0, solver=FiniteRankSolver)
    dense = tinygp.GaussianProcess(kernel, t, diag=0.1, mean=5.0)
    np.testing.assert_allclose(ours.log_probability(y), dense.log_probability(y), atol=1e-8)
    mean, _ = predict(ours, y, t[:5])
    np.testing.assert_allclose(mean, dense.condition(y, t[:5]).gp.loc, atol=1e-8)


def test_samples_have_the_kernels_covariance(x64):
    t = jnp.linspace(0, 1, 12)
    gp = tinygp.GaussianProcess(PeriodicKernel(0.5, 0.7, 1.0), t, diag=0.2, solver=FiniteRankSolver)
    draws = gp.sample(jax.random.key(0), shape=(40000,))
    np.testing.assert_allclose(np.cov(np.asarray(draws).T), gp.covariance, atol=0.05)


def test_refusals_name_the_remedy(x64):
    t = jnp.linspace(0, 1, 12)
    with pytest.raises(ValueError, match=r"loses .* of the variance.*harmonics=64"):
        tinygp.GaussianProcess(PeriodicKernel(0.5, 0.1, 1.0), t, diag=0.2, solver=FiniteRankSolver)
    with pytest.raises(ValueError, match="pass diag="):
        noise = tinygp.noise.Dense(jnp.eye(12))
        tinygp.GaussianProcess(PeriodicKernel(0.5, 0.5, 1.0), t, noise=noise, solver=FiniteRankSolver)
    many = jnp.linspace(0, 1, 20_001)
    gp = tinygp.GaussianProcess(PeriodicKernel(0.5, 0.5, 1.0), many, diag=0.2, solver=FiniteRankSolver)
    with pytest.raises(ValueError, match="predict"):
        gp.condition(jnp.sin(many))
