"""The finite-rank periodic kernel: coefficients against SciPy's, features against the closed form."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special
import tinygp

from mjx_cutting.disturbance import kernel


@pytest.mark.parametrize("length", [0.2, 0.45, 1.2, 8.0, 60.0])
def test_coefficients_are_scaled_bessel_functions(x64, length):
    logs, tail = kernel.log_coefficients(length, 32)
    orders = np.arange(33)
    expected = scipy.special.ive(orders, 1 / length**2) * np.where(orders > 0, 2, 1)
    np.testing.assert_allclose(np.exp(logs), expected, atol=1e-15)
    beyond = np.arange(33, 200)
    np.testing.assert_allclose(
        tail, 2 * scipy.special.ive(beyond, 1 / length**2).sum(), rtol=1e-6, atol=1e-300
    )
    np.testing.assert_allclose(kernel.prior(length, 32)[:33], expected, atol=1e-15)


def test_coefficients_are_positive_finite_and_smooth_even_where_they_underflow(x64):
    for length in (0.2, 3.0, 1e3):
        logs, _ = kernel.log_coefficients(length, 64)
        assert np.isfinite(logs).all()
        slope = jax.grad(lambda u: jnp.sum(jnp.exp(0.5 * kernel.log_prior(u, 1.0, 64))))(jnp.asarray(length))
        assert np.isfinite(slope)


@pytest.mark.parametrize("length", [0.3, 0.9, 4.0])
def test_coefficient_gradient_matches_finite_differences(x64, length):
    slope = jax.jacobian(lambda u: kernel.log_coefficients(u, 32)[0])(jnp.asarray(length))
    h = 1e-6 * length
    numeric = (kernel.log_coefficients(length + h)[0] - kernel.log_coefficients(length - h)[0]) / (2 * h)
    np.testing.assert_allclose(slope, numeric, rtol=1e-7, atol=1e-7)


def test_features_give_the_closed_form_kernel_and_tinygps(x64):
    t = jnp.sort(jax.random.uniform(jax.random.key(0), (40,))) * 7.0
    ours = kernel.PeriodicKernel(0.7, 0.4, 1.7)
    phi = ours.features(t)
    closed = ours(t, t)
    np.testing.assert_allclose((phi * jnp.exp(ours.log_prior())) @ phi.T, closed, atol=1e-11)
    theirs = 1.7**2 * tinygp.kernels.ExpSineSquared(scale=0.7, gamma=2 / 0.4**2)
    np.testing.assert_allclose(closed, theirs(t, t), atol=1e-12)
    y = jnp.cos(t)
    np.testing.assert_allclose(ours.matmul(t, y), closed @ y, atol=1e-10)
    np.testing.assert_allclose(ours.matmul(t[:7], t, y), closed[:7] @ y, atol=1e-10)


def test_tail_matches_the_known_figures_and_bounds_the_length():
    # gauges of the truncation at the lengths and orders where it was tabulated
    assert kernel.tail(0.45, 20) == pytest.approx(7e-14, rel=0.1)
    assert kernel.tail(0.2, 32) == pytest.approx(6e-10, rel=0.1)
    assert kernel.tail(0.1, 60) == pytest.approx(2e-9, rel=0.2)
    for harmonics in (20, 32, 64):
        shortest = kernel.shortest_length(harmonics)
        assert kernel.tail(shortest, harmonics) <= kernel.MAX_TAIL < kernel.tail(0.98 * shortest, harmonics)


def test_the_plus_sign_as_printed_is_no_covariance():
    t = np.linspace(0, 3, 60)
    sine = np.sin(np.pi * (t[:, None] - t[None, :]) / 0.8)
    assert np.linalg.eigvalsh(np.exp(+2 * sine**2 / 0.6**2)).min() < -100
    assert np.linalg.eigvalsh(np.exp(-2 * sine**2 / 0.6**2)).min() > -1e-9


def test_powers_do_not_lose_digits_over_long_times(x64):
    t = np.array([0.0, 1.0, 1e4 + 0.123])
    cos, sin = kernel.powers(jnp.asarray(t) * 19.0, 32)
    angle = 2 * np.pi * np.outer(np.arange(1, 33), np.mod(t * 19.0, 1.0))
    np.testing.assert_allclose(cos, np.cos(angle), atol=1e-12)
    np.testing.assert_allclose(sin, np.sin(angle), atol=1e-12)


def test_other_kernels_are_refused_with_a_remedy():
    with pytest.raises(ValueError, match=r"Matern32.*expected PeriodicKernel"):
        kernel.as_finite_rank(tinygp.kernels.Matern32(1.0))
    two = tinygp.kernels.ExpSineSquared(scale=1.0, gamma=1.0) * tinygp.kernels.ExpSineSquared(
        scale=2.0, gamma=1.0
    )
    with pytest.raises(ValueError, match="Product"):
        kernel.as_finite_rank(two)
