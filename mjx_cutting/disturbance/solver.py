"""A tinygp solver for kernels with few features: O(n m^2) where a dense one is O(n^3).

    gp = tinygp.GaussianProcess(kernel, X, diag=sigma**2, solver=FiniteRankSolver)

K = D + Phi S Phi', B = D^-1/2 Phi S^1/2 [n, m], L = chol(I + B'B). A square root of K is D^1/2 R with

    R = I + B (I + L)^-1 B',   R^-1 = I - B (I + L')^-1 L^-1 B',   log|R| = log|L|.

It is not triangular; no user of a tinygp solver needs that it is. `kernel` may be any `AbstractFiniteRank`,
or tinygp's own constant * ExpSineSquared. Always give `diag`: tinygp's default is 13 % of a posterior
variance in float32. Breaks (ValueError) where the kernel's tail is above `MAX_TAIL` for a length known
outside jit.

`gp.condition(y, X_test)` is tinygp's dense answer, n_test^2 in memory; `predict` below gives mean and
variance in O(n_test m^2).
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.scipy import linalg
from tinygp import GaussianProcess
from tinygp.kernels import Kernel
from tinygp.noise import Diagonal, Noise
from tinygp.solvers.solver import Solver

from mjx_cutting.disturbance.kernel import MAX_TAIL, AbstractFiniteRank, PeriodicKernel, as_finite_rank, tail

MOST_DENSE = 20_000


class FiniteRankSolver(Solver):
    """The solver; built by tinygp as `solver(kernel, X, noise, covariance=...)`."""

    X: Array
    kernel: AbstractFiniteRank
    noise: Noise
    basis: Array  # B' [m, n]: long rows are what the matrix products want
    factor: Array  # L [m, m]

    def __init__(self, kernel: Kernel, X: Array, noise: Noise, *, covariance: Any | None = None):
        """Builds the solver.

        Args:
            kernel: an `AbstractFiniteRank`, or constant * tinygp.kernels.ExpSineSquared.
            X: times [n], s.
            noise: tinygp's diagonal noise (`diag=`), above 0.
            covariance: tinygp passes one for a conditioned process; not used.

        Raises:
            ValueError: another kernel, another noise, or a tail above 1e-8.
        """
        del covariance
        if not isinstance(noise, Diagonal):
            raise ValueError(
                f"FiniteRankSolver got a {type(noise).__name__} noise; expected the diagonal one: pass diag="
            )
        self.kernel = as_finite_rank(kernel)
        _refuse_tail(self.kernel)
        self.X, self.noise = X, noise
        half = jnp.exp(0.5 * self.kernel.log_prior())
        self.basis = self.kernel.features(X).T * half[:, None] / jnp.sqrt(noise.diagonal())
        self.factor = jnp.linalg.cholesky(
            jnp.eye(half.shape[0], dtype=half.dtype) + self.basis @ self.basis.T
        )

    def variance(self) -> Array:
        return self.kernel(self.X) + self.noise.diagonal()

    def covariance(self) -> Array:
        _refuse_dense(self.X.shape[0])
        return self.kernel(self.X, self.X) + self.noise

    def normalization(self) -> Array:
        n = self.X.shape[0]
        own = 0.5 * jnp.sum(jnp.log(self.noise.diagonal()))
        return jnp.sum(jnp.log(jnp.diagonal(self.factor))) + own + 0.5 * n * np.log(2 * np.pi)

    def solve_triangular(self, y: Array, *, transpose: bool = False) -> Array:
        root = _column(jnp.sqrt(self.noise.diagonal()), y)
        if not transpose:
            y = y / root
        # R^-1 = I - B (I + L')^-1 L^-1 B' and R^-T = I - B L'^-1 (I + L)^-1 B'
        first, second = (self._one_plus(), self.factor) if transpose else (self.factor, self._one_plus())
        inner = linalg.solve_triangular(first, self.basis @ y, lower=True)
        inner = linalg.solve_triangular(second, inner, lower=True, trans=1)
        solved = y - self.basis.T @ inner
        return solved / root if transpose else solved

    def dot_triangular(self, y: Array) -> Array:
        inner = linalg.solve_triangular(self._one_plus(), self.basis @ y, lower=True)
        return _column(jnp.sqrt(self.noise.diagonal()), y) * (y + self.basis.T @ inner)

    def condition(self, kernel: Kernel, X_test: Array | None, noise: Noise) -> Any:
        test = self.X if X_test is None else X_test
        _refuse_dense(test.shape[0])
        if isinstance(kernel, PeriodicKernel) and kernel is self.kernel:
            # S - S Phi' K^-1 Phi S = S^1/2 A^-1 S^1/2: no cancellation, and no n x n_test matrix
            return self._spread(test) @ self._spread(test).T + noise
        cross = self.solve_triangular(kernel(self.X, test))
        return kernel(test, test) + noise - cross.T @ cross

    def posterior_features(self, X_test: Array) -> Array:
        """Returns [n_test, m] whose outer product is the posterior covariance at X_test, without noise."""
        return self._spread(X_test)

    def posterior_mean(self, y: Array, X_test: Array) -> Array:
        """Returns the posterior mean [n_test] given data y [n] less the mean function."""
        projected = self.basis @ (y / jnp.sqrt(self.noise.diagonal()))
        weights = linalg.cho_solve((self.factor, True), projected)
        return self.kernel.features(X_test) @ (jnp.exp(0.5 * self.kernel.log_prior()) * weights)

    def _one_plus(self) -> Array:
        return self.factor + jnp.eye(self.factor.shape[0], dtype=self.factor.dtype)

    def _spread(self, X_test: Array) -> Array:
        half = jnp.exp(0.5 * self.kernel.log_prior())
        return linalg.solve_triangular(self.factor, (self.kernel.features(X_test) * half).T, lower=True).T


def predict(gp: GaussianProcess, y: Array, X_test: Array) -> tuple[Array, Array]:
    """Returns posterior mean and variance [n_test] of the process without noise, in O(n m + n_test m^2).

    Args:
        gp: a `tinygp.GaussianProcess` with `solver=FiniteRankSolver`.
        y: data [n].
        X_test: times [n_test], s.
    """
    mean = gp.solver.posterior_mean(y - gp.loc, X_test) + jax.vmap(gp.mean_function)(X_test)
    return mean, jnp.sum(jnp.square(gp.solver.posterior_features(X_test)), 1)


def _column(root: Array, y: Array) -> Array:
    return root.reshape(-1, *([1] * (y.ndim - 1)))


def _refuse_tail(kernel: AbstractFiniteRank) -> None:
    length = getattr(kernel, "length", None)
    if not isinstance(kernel, PeriodicKernel) or isinstance(length, jax.core.Tracer):
        return
    lost = tail(float(np.asarray(length)), kernel.harmonics)
    if lost > MAX_TAIL:
        raise ValueError(
            f"a length of {float(np.asarray(length)):.3g} with {kernel.harmonics} harmonics loses "
            f"{lost:.1e} of the variance; "
            f"expected at most {MAX_TAIL:g}. Use PeriodicKernel(..., harmonics={2 * kernel.harmonics}) or "
            "a longer length."
        )


def _refuse_dense(n: int) -> None:
    if n > MOST_DENSE:
        raise ValueError(
            f"a dense covariance of {n} points takes {8e-9 * n * n:.0f} GB; expected at most {MOST_DENSE} "
            "points. Use "
            "mjx_cutting.disturbance.solver.predict(gp, y, X_test) for mean and variance, or fewer points."
        )
