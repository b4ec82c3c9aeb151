"""The posterior of the feature weights in float64 on the host, once per fit.

With prior N(0, S) on the weights and A = I + S^1/2 G S^1/2 / sigma^2 the posterior is

    w ~ N(S^1/2 A^-1 S^1/2 b / sigma^2,  S^1/2 A^-1 S^1/2).

With trial effects y_r = Phi (g + h_r) + noise, g ~ N(0, S_0), h_r ~ N(0, S_1): `common` is g given all
trials, a new trial is g + h with a fresh h, so its covariance is that of g plus S_1. Every covariance is
kept as S^1/2 B S^1/2 with B between 0 and 1, so that its factor exists however small the prior of a high
harmonic.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

Real = NDArray[np.float64]


@dataclass(frozen=True)
class Weights:
    """Posterior weights of each axis, in the order of the features and in the unit of the data."""

    mean: Real  # [A, m] of the common process
    factor: Real  # [A, m, m] C C' = covariance of the common process
    trial_factor: Real  # [A, m, m] likewise for a new trial
    trial_means: Real  # [R, A, m] of each trial that was fitted: common plus its own


def condition(
    features: Real, residual: Real, priors: tuple[Real, Real], noise: Real, trial_effects: bool
) -> Weights:
    """Returns the posterior of the weights.

    Args:
        features: Phi [N, m] at the stamps.
        residual: [R, N, A], nan where missing.
        priors: diag S_0 and diag S_1, each [A, m]; S_1 is ignored without trial effects.
        noise: [A], above 0.
        trial_effects: whether each trial has its own process.
    """
    seen = np.all(np.isfinite(residual), axis=-1)
    filled = np.where(seen[..., None], residual, 0.0)
    patterns, which = np.unique(seen, axis=0, return_inverse=True)
    which = np.ravel(which)
    grams = [(features * pattern[:, None]).T @ features for pattern in patterns]
    mean, factor, fresh, own = [], [], [], []
    for a in range(residual.shape[2]):
        b = filled[..., a] @ features  # [R, m]
        S0, S1, sigma = priors[0][a], priors[1][a], float(noise[a])
        if trial_effects:
            M, projected = _without_own(grams, which, b, S1, sigma)
        else:
            S1 = np.zeros_like(S0)
            M = sum(grams[k] for k in which) / sigma**2
            projected = b.sum(0) / sigma**2
        half = np.sqrt(S0)
        inner = _inverse(np.eye(len(S0)) + half[:, None] * M * half)
        g = half * (inner @ (half * projected))
        mean.append(g)
        factor.append(half[:, None] * linalg.cholesky(inner, lower=True))
        total = np.sqrt(S0 + S1)
        share = half / np.where(total > 0, total, 1.0)
        both = share[:, None] * inner * share + np.diag(1.0 - share**2)
        fresh.append(total[:, None] * linalg.cholesky(both, lower=True))
        own.append(np.stack([g + _own(grams[k], b_r, g, S1, sigma) for k, b_r in zip(which, b, strict=True)]))
    return Weights(np.stack(mean), np.stack(factor), np.stack(fresh), np.stack(own, axis=1))


def _without_own(grams: list[Real], which: NDArray, b: Real, S1: Real, sigma: float) -> tuple[Real, Real]:
    """Returns (sum_r Phi_r' K_r^-1 Phi_r, sum_r Phi_r' K_r^-1 y_r) with K_r = sigma^2 + Phi_r S_1 Phi_r'."""
    half = np.sqrt(S1) / sigma
    M, projected = np.zeros_like(grams[0]), np.zeros_like(S1)
    for k, G in enumerate(grams):
        trials = which == k
        A = np.eye(len(S1)) + half[:, None] * G * half
        right = np.concatenate([G, b[trials].sum(0)[:, None]], 1)
        solved = linalg.cho_solve(linalg.cho_factor(A, lower=True), half[:, None] * right)
        reduced = (right - (G * half) @ solved) / sigma**2
        M += trials.sum() * reduced[:, :-1]
        projected += reduced[:, -1]
    return 0.5 * (M + M.T), projected


def _own(G: Real, b: Real, g: Real, S1: Real, sigma: float) -> Real:
    """Returns the mean of one trial's own weights given the common ones."""
    half = np.sqrt(S1) / sigma
    A = np.eye(len(S1)) + half[:, None] * G * half
    return half * sigma * linalg.cho_solve(linalg.cho_factor(A, lower=True), half * (b - G @ g)) / sigma


def _inverse(A: Real) -> Real:
    inverse = linalg.cho_solve(linalg.cho_factor(A, lower=True), np.eye(len(A)))
    return 0.5 * (inverse + inverse.T)
