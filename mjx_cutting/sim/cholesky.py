"""Cholesky factor and solves of small symmetric positive definite matrices, unrolled over scalars.

A = L L^T with A given as rows of its lower triangle. Unrolled, each entry is one array over the batch; for
the 7 x 7 mass matrix this is several times faster than batched LAPACK on a CPU. The diagonal of the factor is
kept as its reciprocal, so that solves only multiply. A matrix that is not positive definite gives NaN, which
the environment's guard catches.
"""

from __future__ import annotations

from jax import lax

from mjx_cutting.sim.vectors import Scalar

Lower = list[list[Scalar]]
"""Rows of lengths 1, 2, ... n; in a factor the last of each row is 1 / L_ii."""


def factor(matrix: Lower) -> Lower:
    """The factor L of `matrix`, with reciprocal diagonal."""
    rows: Lower = []
    for i, row in enumerate(matrix):
        new: list[Scalar] = []
        for j in range(i):
            new.append(_reduce(row[j], new, rows[j], j) * rows[j][j])
        new.append(lax.rsqrt(_reduce(row[i], new, new, i)))
        rows.append(new)
    return rows


def forward(lower: Lower, right: list[Scalar]) -> list[Scalar]:
    """L^-1 b."""
    solved: list[Scalar] = []
    for i, row in enumerate(lower):
        solved.append(_reduce(right[i], row, solved, i) * row[i])
    return solved


def backward(lower: Lower, right: list[Scalar]) -> list[Scalar]:
    """L^-T b."""
    count = len(lower)
    solved: list[Scalar] = [0.0] * count
    for i in reversed(range(count)):
        value = right[i]
        for k in range(i + 1, count):
            value = value - lower[k][i] * solved[k]
        solved[i] = value * lower[i][i]
    return solved


def solve(lower: Lower, right: list[Scalar]) -> list[Scalar]:
    """A^-1 b, from the factor of A."""
    return backward(lower, forward(lower, right))


def _reduce(value: Scalar, a: list[Scalar], b: list[Scalar], count: int) -> Scalar:
    for k in range(count):
        value = value - a[k] * b[k]
    return value
