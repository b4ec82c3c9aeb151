"""Three-vectors as tuples of scalars, with constant zeros and ones folded away while tracing.

Every component is an array of any batch shape (or a Python float), so a function written on these tuples is
elementwise in the batch: under `jax.vmap` each component becomes one contiguous array over the environments,
which is what a vector unit wants, and no small matrix is ever laid out in memory. A component that is a
Python float is a constant known while tracing; products with 0 and 1 and sums with 0 then cost nothing, which
removes most of the arithmetic of a robot whose axes are at right angles. Folding x * 0 to 0 assumes that x is
finite.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from jax import Array

Scalar = Array | float
Vector = tuple[Scalar, Scalar, Scalar]
Frame = tuple[Vector, Vector, Vector]
"""Three columns: the x, y and z axis of a frame, each in world axes."""

ZERO: Vector = (0.0, 0.0, 0.0)
IDENTITY: Frame = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def mul(a: Scalar, b: Scalar) -> Scalar:
    """a b, folded where a factor is the constant 0, 1 or -1."""
    for x, y in ((a, b), (b, a)):
        if isinstance(x, float):
            if x == 0.0:
                return 0.0
            if x == 1.0:
                return y
            if x == -1.0:
                return -y
    return a * b


def add(a: Scalar, b: Scalar) -> Scalar:
    """a + b, folded where a term is the constant 0."""
    if isinstance(a, float) and a == 0.0:
        return b
    if isinstance(b, float) and b == 0.0:
        return a
    return a + b


def sub(a: Scalar, b: Scalar) -> Scalar:
    """a - b, folded where a term is the constant 0."""
    if isinstance(a, float) and a == 0.0:
        return -b
    if isinstance(b, float) and b == 0.0:
        return a
    return a - b


def total(terms: Iterable[Scalar]) -> Scalar:
    """Sum of scalars."""
    value: Scalar = 0.0
    for term in terms:
        value = add(value, term)
    return value


def plus(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return (add(a[0], b[0]), add(a[1], b[1]), add(a[2], b[2]))


def minus(a: Vector, b: Vector) -> Vector:
    """a - b."""
    return (sub(a[0], b[0]), sub(a[1], b[1]), sub(a[2], b[2]))


def scale(k: Scalar, a: Vector) -> Vector:
    """k a."""
    return (mul(k, a[0]), mul(k, a[1]), mul(k, a[2]))


def dot(a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
    """a . b, for sequences of any equal length."""
    return total(mul(x, y) for x, y in zip(a, b, strict=True))


def cross(a: Vector, b: Vector) -> Vector:
    """a x b."""
    return (
        sub(mul(a[1], b[2]), mul(a[2], b[1])),
        sub(mul(a[2], b[0]), mul(a[0], b[2])),
        sub(mul(a[0], b[1]), mul(a[1], b[0])),
    )


def combine(weights: Sequence[Scalar], frame: Frame) -> Vector:
    """The vector with coordinates `weights` in `frame`, in world axes."""
    return plus(plus(scale(weights[0], frame[0]), scale(weights[1], frame[1])), scale(weights[2], frame[2]))


def project(frame: Frame, a: Vector) -> Vector:
    """Coordinates in `frame` of a vector in world axes."""
    return (dot(frame[0], a), dot(frame[1], a), dot(frame[2], a))


def constant(values: Any) -> Vector:
    """Three numbers as constants that folding can see; magnitudes below 1e-12 become zero."""
    x, y, z = (0.0 if abs(float(v)) < 1e-12 else float(v) for v in values)
    return (x, y, z)
