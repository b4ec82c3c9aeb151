"""Welch's unequal-variance t-test, two-tailed, and confidence intervals of a mean.

    t = (m_a - m_b) / sqrt(s_a^2/n_a + s_b^2/n_b),
    nu = (s_a^2/n_a + s_b^2/n_b)^2 / [ (s_a^2/n_a)^2/(n_a - 1) + (s_b^2/n_b)^2/(n_b - 1) ],
    p = P(|T_nu| >= |t|)

The paper uses this test and prints one-tailed p values; these here are two-tailed. It assumes independent
samples
that are roughly normal in the mean: rollouts, not the steps of a rollout, are the samples. Reference:
    Welch 1947,
Biometrika 34.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import special


@dataclass(frozen=True)
class Welch:
    """Result of a test: the difference of the means (a - b), t, degrees of freedom and the two-tailed p
    value.
    """

    difference: float
    t: float
    degrees_of_freedom: float
    p_value: float


def welch(a: ArrayLike, b: ArrayLike) -> Welch:
    """Return Welch's test of two samples, each [n] with n of at least 2.

    Two samples without any spread give t = 0 and p = 1 where their means agree, else infinite t and p = 0.

    Raises: ValueError for fewer than two values or values that are not finite.
    """
    a, b = _sample("a", a), _sample("b", b)
    va, vb = a.var(ddof=1) / a.size, b.var(ddof=1) / b.size
    difference = float(a.mean() - b.mean())
    if va + vb == 0.0:
        same = difference == 0.0
        t = 0.0 if same else math.copysign(math.inf, difference)
        return Welch(difference, t, float(a.size + b.size - 2), 1.0 if same else 0.0)
    t = difference / math.sqrt(va + vb)
    # Shares of the summed variance keep the squares away from underflow.
    share = va / (va + vb)
    freedom = 1.0 / (share**2 / (a.size - 1) + (1.0 - share) ** 2 / (b.size - 1))
    return Welch(difference, t, freedom, two_tailed(t, freedom))


def two_tailed(t: float, degrees_of_freedom: float) -> float:
    """Return P(|T| >= |t|) for Student's T with the given degrees of freedom (above 0)."""
    return float(
        special.betainc(degrees_of_freedom / 2, 0.5, degrees_of_freedom / (degrees_of_freedom + t * t))
    )


def mean_interval(
    values: ArrayLike, level: float = 0.95, axis: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the mean of samples along an axis, and the low and high end of its confidence interval.

    Arguments:
        values: samples; a single one gives an interval of no width.
        level: confidence, between 0 and 1.
        axis: along which the samples lie.
    """
    values = np.asarray(values, float)
    n = values.shape[axis]
    mean = values.mean(axis=axis)
    if n < 2:
        return mean, mean, mean
    half = special.stdtrit(n - 1, 0.5 + level / 2) * values.std(axis=axis, ddof=1) / math.sqrt(n)
    return mean, mean - half, mean + half


def _sample(name: str, values: ArrayLike) -> np.ndarray:
    values = np.asarray(values, float).ravel()
    if values.size < 2 or not np.all(np.isfinite(values)):
        raise ValueError(
            f"got {values.size} values in sample {name}, {int(np.sum(~np.isfinite(values)))} of them not "
            f"finite; "
            "expected two or more finite ones; run more rollouts or leave the failed ones out"
        )
    return values
