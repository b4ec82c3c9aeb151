"""Fits of an effect that is linear for given shapes, over a grid of shapes and any set of trials.

Per trial and shape only X^T X and X^T e are kept, so that a fit to some trials and the error on the others
are sums of small matrices: the shape is searched over the whole grid, and each held-out fold its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.course import Course

_PHASES = 256
_ALIGNED = 8
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Sums:
    """X^T X [R, P, 3, k, k] and X^T e [R, P, 3, k] by trial, shape and axis."""

    square: Array
    product: Array


def sums(columns: Callable[[Course, Array], Array], courses: Sequence[Course], shapes: Array) -> Sums:
    """Sufficient statistics over shapes [P, d] of `columns`, [T, 3, k] at one shape, less what each trial can
    imitate (`Course.same`)."""
    squares, products = [], []
    for course in courses:
        known = np.concatenate(
            [course.same.reshape(-1, 3, course.same.shape[-1]), course.left_n[..., None]], axis=-1
        )
        known = np.ascontiguousarray(np.moveaxis(known, 1, 0))
        own = np.swapaxes(known[..., :-1], 1, 2) @ known
        each = [_of_one(columns(course, shape), known, own, course.apart) for shape in shapes]
        squares.append(np.stack([square for square, _ in each]))
        products.append(np.stack([product for _, product in each]))
    return Sums(np.stack(squares), np.stack(products))


def _of_one(columns: Array, known: Array, own: Array, apart: bool) -> tuple[Array, Array]:
    """X^T X [3, k, k] and X^T e [3, k] by axis of the columns X = C - Q (Q^T C), from products alone.

    Arguments: C [T, 3, k]; Q and e side by side, [3, T, q + 1]; Q^T of those, [3, q, q + 1]; whether C itself
        is taken for X.
    """
    turned = np.ascontiguousarray(np.transpose(columns, (1, 2, 0)))
    square, cross = turned @ np.swapaxes(turned, 1, 2), turned @ known
    if apart:
        return square, cross[..., -1]
    beside = cross[..., :-1]  # C^T Q by axis
    share = beside.sum(axis=0).T  # Q^T C
    mixed = beside @ share
    square = square - mixed - np.swapaxes(mixed, 1, 2) + share.T @ own[..., :-1] @ share
    return square, cross[..., -1] - own[..., -1] @ share


def solve(found: Sums, use: Array, weight: Array) -> tuple[int, Array, Array]:
    """Best shape, its coefficients [k], and the fall [P] of the weighted squared error at every shape.

    Arguments:
        use: [R] 1 for trials fitted to.
        weight: [3] 1 / standard deviation of each axis.
    """
    square = np.einsum("rpakl,r,a->pkl", found.square, use, weight**2)
    product = np.einsum("rpak,r,a->pk", found.product, use, weight**2)
    trace = np.trace(square, axis1=1, axis2=2)[:, None, None]
    ridge = (1e-9 * trace + 1e-30) * np.eye(square.shape[-1])
    coefficients = np.linalg.solve(square + ridge, product[..., None])[..., 0]
    fall = np.einsum("pk,pk->p", coefficients, product)
    best = int(np.argmax(fall))
    return best, coefficients[best], fall


def error_change(found: Sums, shape: int, coefficients: Array) -> Array:
    """[R, 3] change of each trial's squared error, N^2, with `shape` at `coefficients` [k] or [R, k]."""
    own = np.broadcast_to(coefficients, (len(found.product), found.product.shape[-1]))
    square = np.einsum("rakl,rk,rl->ra", found.square[:, shape], own, own)
    return square - 2.0 * np.einsum("rak,rk->ra", found.product[:, shape], own)


def solve_in_phase(found: Sums, use: Array, weight: Array) -> tuple[int, Array]:
    """Best shape and its coefficients [k], where every trial has a phase of its own; as `solve`."""
    square = np.einsum("rpakl,a->rpkl", found.square, weight**2)
    product = np.einsum("rpak,a->rpk", found.product, weight**2)
    ridge = 1e-9 * np.trace(square, axis1=2, axis2=3)[..., None, None] + 1e-30
    alone = np.linalg.solve(square + ridge * np.eye(square.shape[-1]), product[..., None])[..., 0]
    best = int(np.argmax(np.einsum("rpk,rpk,r->p", alone, product, use)))
    c = alone[int(np.argmax(use * np.sum(alone[:, best] * product[:, best], axis=1))), best]
    for _ in range(_ALIGNED):
        turn = phases(found, best, c, weight)
        whole = np.einsum("rkl,rkm,rmn,r->ln", turn, square[:, best], turn, use)
        pulled = np.einsum("rkl,rk,r->l", turn, product[:, best], use)
        c = np.linalg.solve(whole + 1e-9 * np.trace(whole) * np.eye(len(c)), pulled)
    return best, c


def phases(found: Sums, shape: int, c: Array, weight: Array) -> Array:
    """[R, k, k] rotation of the coefficients `c` to each trial's own phase, the best of a fine grid."""
    angle = 2.0 * np.pi * np.arange(_PHASES)[:, None, None] / _PHASES
    half = np.eye(len(c) // 2)
    turns = np.cos(angle) * np.eye(len(c)) + np.sin(angle) * np.kron([[0.0, -1.0], [1.0, 0.0]], half)
    turned = turns @ c
    product = np.einsum("rak,a->rk", found.product[:, shape], weight**2)
    square = np.einsum("rakl,a->rkl", found.square[:, shape], weight**2)
    gain = 2.0 * product @ turned.T - np.einsum("pk,rkl,pl->rp", turned, square, turned)
    return turns[np.argmax(gain, axis=1)]
