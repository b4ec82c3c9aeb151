"""Fits of an effect that is linear for given shapes, over a grid of shapes and any set of trials.

Per trial and shape only X^T X and X^T e are kept, so that a fit to some trials and the error on the others
are sums of small matrices: the shape is searched over the whole grid, and each held-out fold its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.records.blocks import block_edges, block_means
from mjx_cutting.tracing.records.course import Course

_PHASES = 256
_NEARLY = 0.02
_ALIGNED = 8
_MOST_BLOCKS = 8192
_FEWER_BLOCKS = 2048
_SHAPES_AT_ONCE = 32
_CYCLES = 20.0
_BLOCKS_A_CYCLE = 32
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Sums:
    """X^T X [R, P, 3, k, k] and X^T e [R, P, 3, k] by trial, shape and axis."""

    square: Array
    product: Array


def put_together(parts: Sequence[Sums], places: Sequence[NDArray[np.integer]]) -> Sums:
    """The sums of some shapes each as those of all, in the order of their `places` [P] among them."""
    order = np.argsort(np.concatenate(places))
    sides = zip(*((each.square, each.product) for each in parts), strict=True)
    square, product = (np.concatenate(side, axis=1)[:, order] for side in sides)
    return Sums(square, product)


def sums(columns: Callable[[Course, Array], Array], courses: Sequence[Course], shapes: Array) -> Sums:
    """Sufficient statistics over shapes [P, d] of `columns`, [T, 3, k] at one shape, less what each trial can
    imitate (`Course.same`)."""

    def products(course: Course, known: Array) -> tuple[Array, Array]:
        square, cross = [], []
        for shape in shapes:
            turned = np.ascontiguousarray(np.transpose(columns(course, shape), (1, 2, 0)))
            square.append(turned @ np.swapaxes(turned, 1, 2))
            cross.append(turned @ known)
        return np.stack(square), np.stack(cross)

    return _by_trial(courses, products)


def profiled_sums(
    courses: Sequence[Course],
    along: Callable[[Course], Array],
    carrier: Callable[[Course], Array],
    profile: Callable[[Array, Array], Array],
    shapes: Array,
) -> Sums:
    """The same of the columns of a shape that are its profile along the trial times each of the waves.

    Long records are first summed over blocks of time, short against whatever a profile does.

    Arguments:
        along: [T] what the profile is a function of.
        carrier: [T, 3, k] the waves.
        profile: [P, B, 3] along each axis at places [B], of shapes [P, d].
    """

    def products(course: Course, known: Array) -> tuple[Array, Array]:
        place = along(course)
        edges = block_edges(len(place), _MOST_BLOCKS)
        energy, beside = _in_blocks(carrier(course), known, edges)
        parts, mean = [], block_means(place, edges)
        for first in range(0, len(shapes), _SHAPES_AT_ONCE):
            share = profile(mean, shapes[first : first + _SHAPES_AT_ONCE])
            parts.append((_summed(share**2, energy), _summed(share, beside)))
        square, cross = (np.concatenate(side) for side in zip(*parts, strict=True))
        return square, cross

    return _by_trial(courses, products)


def stacked_sums(
    courses: Sequence[Course],
    along: Callable[[Course], Array],
    carrier: Callable[[Course], Array],
    profile: Callable[[Array, Array], Array],
) -> Callable[[Array], Sums]:
    """The statistics of several shapes [n, d] at once, the columns of one after those of another, as a
    function of them that asks nothing of the records again; arguments as of `profiled_sums`."""
    read = []
    for course in courses:
        known, own = _known(course)
        if course.apart:
            known[..., :-1], own[:] = 0.0, 0.0
        place = along(course)
        edges = block_edges(len(place), _FEWER_BLOCKS)
        read.append((block_means(place, edges), *_in_blocks(carrier(course), known, edges), own))
    # in the blocks that a shorter record lacks there is nothing
    places, energies, besides, owns = (_padded(each) for each in zip(*read, strict=True))
    trials, blocks, _, waves = energies.shape[:4]
    energies, flat = (np.swapaxes(each, 1, 2).reshape(trials, 3, blocks, -1) for each in (energies, besides))

    def at(shapes: Array) -> Sums:
        share = profile(places.ravel(), shapes).reshape(len(shapes), *places.shape, 3)
        share = np.moveaxis(share, [1, 3], [0, 1])  # [R, 3, n, B]
        pairs = (share[:, :, :, None] * share[:, :, None]).reshape(trials, 3, -1, blocks)
        own = (pairs @ energies).reshape(trials, 3, len(shapes), len(shapes), waves, waves)
        own = np.swapaxes(own, 3, 4).reshape(trials, 3, len(shapes) * waves, -1)
        cross = (share @ flat).reshape(trials, 3, len(shapes) * waves, -1)
        square, product = _less_same(own, cross, owns, apart=False)
        return Sums(square[:, None], product[:, None])

    return at


def _summed(share: Array, value: Array) -> Array:
    """[P, 3, ...] sums over blocks of shares [P, B, 3] of a value [B, 3, ...] along each axis."""
    return np.stack([np.tensordot(share[..., axis], value[:, axis], 1) for axis in range(3)], axis=1)


def _in_blocks(carrier: Array, known: Array, edges: NDArray[np.integer]) -> tuple[Array, Array]:
    """[B, 3, k, k] and [B, 3, k, q + 1] sums over blocks of waves [T, 3, k] times one another, and times what
    is `known` [3, T, q + 1]."""
    energy = np.add.reduceat(carrier[..., None] * carrier[:, :, None], edges, axis=0)
    beside = np.add.reduceat(carrier[..., None] * np.swapaxes(known, 0, 1)[:, :, None], edges, axis=0)
    return energy, beside


def _padded(arrays: Sequence[Array]) -> Array:
    """Arrays as one [R, ...], with zeros behind those that are shorter along an axis."""
    shape = np.max([each.shape for each in arrays], axis=0)
    whole = np.zeros((len(arrays), *shape))
    for row, each in zip(whole, arrays, strict=True):
        row[tuple(slice(size) for size in each.shape)] = each
    return whole


def harmonic_sums(
    courses: Sequence[Course],
    along: Callable[[Course], Array],
    carriers: Callable[[Course], Array],
    frequency: Array,
) -> Sums:
    """The same of columns cos(w u) c_i, then -sin(w u) c_i, w being 2 pi times each `frequency` [P].

    Frequencies near one another are taken together: what turns with their middle one is summed over blocks of
    time, in which the others hardly turn against it.

    Arguments:
        along: [T] u, in 1 / the unit of frequency.
        carriers: [T, 3, c] the waves c_i.
    """

    def products(course: Course, known: Array) -> tuple[Array, Array]:
        place, wave = along(course), np.moveaxis(carriers(course), 0, -1)
        beside = wave[..., None] * known[:, None]  # [3, c, T, q + 1]
        pairs = wave[:, :, None] * wave[:, None]  # [3, c, c, T]
        once = _turned(place, np.moveaxis(beside, 2, -1), frequency)
        twice = _turned(place, pairs, 2.0 * frequency)
        level = pairs.sum(axis=-1)
        upper = np.concatenate([level + twice.real, twice.imag], axis=-1)
        lower = np.concatenate([twice.imag, level - twice.real], axis=-1)
        square = 0.5 * np.concatenate([upper, lower], axis=-2)
        return square, np.concatenate([once.real, once.imag], axis=2)

    return _by_trial(courses, products)


def _by_trial(courses: Sequence[Course], products: Callable[[Course, Array], tuple[Array, Array]]) -> Sums:
    """The sums from C^T C [P, 3, k, k] and C^T (Q, e) [P, 3, k, q + 1] of the columns C of each trial, given
    the trial and (Q, e) [3, T, q + 1]."""
    squares, cross = [], []
    for course in courses:
        known, own = _known(course)
        found = _less_same(*products(course, known), own, course.apart)
        squares.append(found[0])
        cross.append(found[1])
    return Sums(np.stack(squares), np.stack(cross))


def _turned(place: Array, value: Array, frequency: Array) -> NDArray[np.complexfloating]:
    """[P, ...] sums over `value` [..., T] times exp(-2 pi i f u), u the `place` [T], f of `frequency` [P]."""
    flat = value.reshape(-1, len(place))
    span = max(float(np.ptp(place)), 1e-300)
    found = np.zeros((len(frequency), len(flat)), dtype=complex)
    live = flat.any(axis=1)
    flat = flat[live]
    group = np.floor((frequency - frequency.min()) * span / (2.0 * _CYCLES)).astype(int)
    for each in np.unique(group):
        members = np.flatnonzero(group == each)
        middle = 0.5 * (frequency[members].min() + frequency[members].max())
        away = frequency[members] - middle
        edges = block_edges(len(place), int(_BLOCKS_A_CYCLE * (1.0 + span * float(np.abs(away).max()))))
        mean = block_means(place, edges)
        within = place - np.repeat(mean, np.diff(edges, append=len(place)))
        turned = flat * np.exp(-2j * np.pi * middle * place)
        slow = np.exp(-2j * np.pi * np.multiply.outer(away, mean))
        # to second order also how the value is spread within a block: shapes of two groups are compared
        moments = (turned, turned * within, turned * within**2)
        level, slope, curve = (np.add.reduceat(each, edges, axis=1).T for each in moments)
        turn = -2j * np.pi * away[:, None]
        found[np.ix_(members, live)] = slow @ level + turn * (slow @ slope) + 0.5 * turn**2 * (slow @ curve)
    return found.reshape(len(frequency), *value.shape[:-1])


def _known(course: Course) -> tuple[Array, Array]:
    """What a trial can imitate, Q, and what is left, e, side by side, [3, T, q + 1]; Q^T of those by axis."""
    same = course.same.reshape(-1, 3, course.same.shape[-1])
    known = np.concatenate([same, course.left_n[..., None]], axis=-1)
    known = np.ascontiguousarray(np.moveaxis(known, 1, 0))
    return known, np.swapaxes(known[..., :-1], 1, 2) @ known


def _less_same(square: Array, cross: Array, own: Array, apart: bool) -> tuple[Array, Array]:
    """X^T X [P, 3, k, k] and X^T e [P, 3, k] by axis of the columns X = C - Q (Q^T C), from products alone.

    Arguments: C^T C [P, 3, k, k]; C^T (Q, e) [P, 3, k, q + 1]; Q^T (Q, e) [3, q, q + 1]; whether C itself is
        taken for X.
    """
    if apart:
        return square, cross[..., -1]
    beside = cross[..., :-1]
    share = np.swapaxes(beside.sum(axis=1), 1, 2)[:, None]  # Q^T C
    mixed = beside @ share
    square = square - mixed - np.swapaxes(mixed, 2, 3) + np.swapaxes(share, 2, 3) @ own[..., :-1] @ share
    return square, cross[..., -1] - own[..., -1] @ share[:, 0]


def solve(found: Sums, use: Array, weight: Array, shared: bool = False) -> tuple[int, Array, Array]:
    """Best shape, its coefficients [k], and the fall [P] of the weighted squared error at every shape.

    Arguments:
        use: [R] 1 for trials fitted to.
        weight: [3] 1 / standard deviation of each axis.
        shared: whether that one is best which explains most in all trials but the one that it does most in;
            of those that do nearly as much there (its end may show in that one alone) the one that does most.
    """
    square = np.einsum("rpakl,r,a->pkl", found.square, use, weight**2)
    product = np.einsum("rpak,r,a->pk", found.product, use, weight**2)
    trace = np.trace(square, axis1=1, axis2=2)[:, None, None]
    ridge = (1e-9 * trace + 1e-30) * np.eye(square.shape[-1])
    coefficients = np.linalg.solve(square + ridge, product[..., None])[..., 0]
    fall = np.einsum("pk,pk->p", coefficients, product)
    in_others = fall - _most_in_one(found, use, weight, coefficients) if shared else fall
    most = float(in_others.max())
    best = int(np.argmax(np.where(in_others >= most - _NEARLY * abs(most), fall, -np.inf)))
    return best, coefficients[best], fall


def _most_in_one(found: Sums, use: Array, weight: Array, coefficients: Array) -> Array:
    """[P] fall of the weighted squared error in the trial in which each shape explains most, at its
    `coefficients` [P, k]."""
    square = np.einsum("rpakl,pk,pl,a->rp", found.square, coefficients, coefficients, weight**2)
    product = np.einsum("rpak,pk,a->rp", found.product, coefficients, weight**2)
    return np.asarray(np.max((2.0 * product - square) * use[:, None], axis=0))


def error_change(found: Sums, shape: int, coefficients: Array) -> Array:
    """[R, 3] change of each trial's squared error, N^2, with `shape` at `coefficients` [k] or [R, k]."""
    own = np.broadcast_to(coefficients, (len(found.product), found.product.shape[-1]))
    product = np.einsum("rak,rk->ra", found.product[:, shape], own)
    return added_energy(found, shape, coefficients) - 2.0 * product


def added_energy(found: Sums, shape: int, coefficients: Array) -> Array:
    """[R, 3] energy of what `shape` adds to each trial at `coefficients` [k] or [R, k], N^2."""
    own = np.broadcast_to(coefficients, (len(found.product), found.product.shape[-1]))
    return np.einsum("rakl,rk,rl->ra", found.square[:, shape], own, own)


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
