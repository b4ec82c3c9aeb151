"""Dynamic time warping with an open end, as a wavefront over anti-diagonals.

    D(i, j) = min( D(i-1, j) + d, D(i, j-1) + d, D(i-1, j-1) + 2 d ),   d = |x_i - y_j|_2,   D(0, 0) = d

is the step pattern symmetric2 (Sakoe & Chiba, IEEE TASSP 26, 1978; named as in Giorgino, J. Stat. Softw.
31, 2009): the diagonal counts twice, so every path to (i, j) has the weight i + j + 2 and costs are
comparable after division by n + m. Open end: the whole query against the best truncation of the reference,
min over j of D(n - 1, j) / (n + j + 1). Cells of one anti-diagonal i + j = k do not depend on each other,
so the recursion is a `lax.scan` over k with a vector operation on each step; pairs follow each other, so that
one stays in the cache. The first cell counts once, as in those implementations.

Not symmetric: with an open end the distance of (a, b) is not that of (b, a). Breaks for series that must
not be stretched (a warp changes every period in them): bound it by `radius`.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike, NDArray

from mjx_cutting import _platform

STEPS = {"symmetric2": 2.0, "symmetric1": 1.0}
_FAR = 1e140
_DIAGONAL, _QUERY, _REFERENCE = 0, 1, 2


@dataclass(frozen=True, eq=False)
class Warp:
    """The best path of one query through one reference.

    Fields:
        distance: normalised (symmetric2) or plain (symmetric1) cost; inf where the radius allows no path.
        query, reference: [L] sample numbers matched, from (0, 0) to (n - 1, end).
        end: last sample of the reference that was used.
    """

    distance: float
    query: NDArray[np.int64]
    reference: NDArray[np.int64]
    end: int


def distances(
    series: Sequence[ArrayLike],
    *,
    radius: int | None = None,
    open_end: bool = True,
    step: str = "symmetric2",
) -> NDArray[np.float64]:
    """Returns the distances [R, R] of every series (row, the query) to every other (column, the reference).

    Args:
        series: R arrays [T_r, C] (or [T_r]), finite, at least 2 samples, of any lengths.
        radius: Sakoe-Chiba bound on |i - j|, samples; None for no bound.
        open_end: leave the end of the reference free.
        step: "symmetric2" (normalised) or "symmetric1" (diagonal counts once, not normalised).

    Raises:
        ValueError: series that are too short, of different channels or not finite; an unknown step.
    """
    arrays = [checked_series(each, f"series {r}") for r, each in enumerate(series)]
    weight = _weight(step, radius, arrays)
    queries, references = np.divmod(np.arange(len(arrays) ** 2), len(arrays))
    different = queries != references
    queries, references = queries[different], references[different]
    result = np.zeros((len(arrays), len(arrays)))
    if not len(queries):
        return result
    lengths = np.array([len(a) for a in arrays])
    with _platform.x64():
        stacked = jnp.asarray(_stack(arrays))
        found = _all_pairs(
            stacked, jnp.asarray(lengths), jnp.asarray(queries), jnp.asarray(references),
            _band(radius), jnp.asarray(weight), open_end, step == "symmetric2",
        )  # fmt: skip
    result[queries, references] = np.asarray(found)
    return result


def warp(
    query: ArrayLike,
    reference: ArrayLike,
    *,
    radius: int | None = None,
    open_end: bool = True,
    step: str = "symmetric2",
) -> Warp:
    """Returns the best path of `query` [n, C] through `reference` [m, C]; arguments as in `distances`."""
    x, y = checked_series(query, "the query"), checked_series(reference, "the reference")
    weight = _weight(step, radius, [x, y])
    lengths = np.array([len(x), len(y)])
    with _platform.x64():
        stacked = jnp.asarray(_stack([x, y]))
        distance, end, i, j, kept = _one_path(
            stacked[0], stacked[1], jnp.asarray(lengths[0]), jnp.asarray(lengths[1]),
            _band(radius), jnp.asarray(weight), open_end, step == "symmetric2",
        )  # fmt: skip
        kept = np.asarray(kept)
        return Warp(
            float(distance),
            np.asarray(i, np.int64)[kept][::-1],
            np.asarray(j, np.int64)[kept][::-1],
            int(end),
        )


def _wavefront(
    x: Array, y: Array, n: Array, m: Array, band: Array | None, weight: Array, record: bool
) -> tuple[Array, Array]:
    """Returns (last row D(n - 1, k - n + 1) [K], moves [K, N]) over the anti-diagonals k; moves are empty
    unless asked for. x and y are padded to [C, N], channels first for vectors; n, m are their true lengths.

    The state has one cell more than the diagonal, its border. Outside the reference everything is
    `_FAR` away, so no cell needs a mask; paths that went there are recognised by their cost at the end."""
    size = x.shape[1]
    i = jnp.arange(size)
    outside = jnp.full_like(y, _FAR)
    known = jnp.where(i < m, y, _FAR)
    turned = jnp.concatenate([outside, known[:, ::-1], outside], 1)

    def advance(carry: tuple[Array, Array], k: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        before, before_that = carry
        facing = jax.lax.dynamic_slice_in_dim(turned, 2 * size - 1 - k, size, 1)  # y[k - i]
        d = jnp.sqrt(sum(jnp.square(x[c] - facing[c]) for c in range(x.shape[0])))
        both, straight = before_that[:-1] + weight * d, jnp.minimum(before[:-1], before[1:]) + d
        cost = jnp.minimum(both, straight)
        if band is not None:
            cost = jnp.where(jnp.abs(2 * i - k) <= band, cost, jnp.inf)
        move = jnp.zeros((0,), jnp.uint8)
        if record:
            aside = jnp.where(before[:-1] <= before[1:], _QUERY, _REFERENCE)
            move = jnp.where(both <= straight, _DIAGONAL, aside).astype(jnp.uint8)
        return (jnp.concatenate([border, cost]), before), (cost[n - 1], move)

    border = jnp.full(1, jnp.inf, x.dtype)
    start = jnp.full(size + 1, jnp.inf, x.dtype)
    _, (row, moves) = jax.lax.scan(advance, (start, start.at[0].set(0.0)), jnp.arange(2 * size - 1))
    first = jnp.sqrt(jnp.sum(jnp.square(x[:, 0] - y[:, 0])))
    return jnp.where(row < 0.1 * _FAR, row - (weight - 1.0) * first, jnp.inf), moves  # D(0, 0) counts once


def _end(row: Array, n: Array, m: Array, open_end: bool, normalise: bool) -> tuple[Array, Array]:
    """Returns (distance, last reference sample) from the last row over the anti-diagonals."""
    j = jnp.arange(row.shape[0]) - (n - 1)
    allowed = (j >= 0) & (j < m) if open_end else j == m - 1
    cost = row / (n + j + 1) if normalise else row
    cost = jnp.where(allowed, cost, jnp.inf)
    best = jnp.argmin(cost)
    return cost[best], j[best]


@functools.partial(_platform.jit, static_argnames=("open_end", "normalise"))
def _all_pairs(
    stacked: Array,
    lengths: Array,
    queries: Array,
    references: Array,
    band: Array | None,
    weight: Array,
    open_end: bool,
    normalise: bool,
) -> Array:
    def one(q: Array, r: Array) -> Array:
        row, _ = _wavefront(stacked[q], stacked[r], lengths[q], lengths[r], band, weight, False)
        return _end(row, lengths[q], lengths[r], open_end, normalise)[0]

    return jax.lax.map(lambda pair: one(*pair), (queries, references))


@functools.partial(_platform.jit, static_argnames=("open_end", "normalise"))
def _one_path(
    x: Array, y: Array, n: Array, m: Array, band: Array | None, weight: Array, open_end: bool, normalise: bool
) -> tuple[Array, Array, Array, Array, Array]:
    row, moves = _wavefront(x, y, n, m, band, weight, True)
    distance, end = _end(row, n, m, open_end, normalise)

    def back(at: tuple[Array, Array, Array], _: None) -> tuple[tuple[Array, Array, Array], tuple[Array, ...]]:
        i, j, on = at
        move = moves[jnp.maximum(i + j, 0), jnp.maximum(i, 0)]
        first = (i == 0) & (j == 0)
        up = i - jnp.where(move != _REFERENCE, 1, 0)
        left = j - jnp.where(move != _QUERY, 1, 0)
        return (jnp.where(first, i, up), jnp.where(first, j, left), on & ~first), (i, j, on)

    start = (n - 1, end, jnp.isfinite(distance))
    _, (i, j, kept) = jax.lax.scan(back, start, None, length=moves.shape[0])
    return distance, end, i, j, kept


def checked_series(series: ArrayLike, name: str) -> NDArray[np.float64]:
    """Returns `series` as [T, C] float64; ValueError naming it where it is too short or not finite."""
    array = np.asarray(series, np.float64)
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2 or len(array) < 2:
        raise ValueError(f"{name} has shape {np.shape(series)}; expected [T, C] with at least 2 samples")
    if not np.isfinite(array).all():
        where = int(np.flatnonzero(~np.isfinite(array).all(1))[0])
        raise ValueError(f"{name} is not finite at sample {where}; fill the gap or cut the trial there")
    return array


def _weight(step: str, radius: int | None, arrays: list[NDArray[np.float64]]) -> float:
    if step not in STEPS:
        raise ValueError(f"got step {step!r}; expected one of {', '.join(STEPS)}")
    if radius is not None and radius < 0:
        raise ValueError(f"got radius {radius}; expected at least 0 samples, or None for no bound")
    channels = {a.shape[1] for a in arrays}
    if len(channels) > 1:
        raise ValueError(f"the series have {sorted(channels)} channels; expected the same number in all")
    return STEPS[step]


def _stack(arrays: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    longest = max(len(a) for a in arrays)
    return np.stack([np.pad(a.T, ((0, 0), (0, longest - len(a)))) for a in arrays])


def _band(radius: int | None) -> Array | None:
    return None if radius is None else jnp.asarray(radius)
