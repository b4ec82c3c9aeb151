"""A long elementwise computation as one CPU kernel.

XLA's CPU backend makes one loop per output of an elementwise graph and recomputes in each what the outputs
share: with the hundreds of shared values of a robot's dynamics that costs tens of times the arithmetic and
most of the compile time. A reduction of several operands at once, however, is emitted as ONE loop whose body
is the user's combiner. So a function from scalars to scalars is handed to `lax.reduce` as a combiner that
ignores its accumulator, over an axis of length two holding the same values twice (an axis of length one would
be optimised to the identity; LLVM drops the first of the two). The loop over the batch is then vectorised as
a whole.

Found by trial, with XLA of late 2026: a kernel should have fewer than about 100 arguments (LLVM hoists no
more loads than that out of the inner loop, which must vanish for the outer one to be vectorised) and fewer
than about 3,000 operations (beyond, the emitter splits the combiner into functions and duplicates work).
All results of the reduction are kept alive by a barrier: a canonicalisation for unused results walks every
path of the graph, which takes for ever. Two facts about XLA are relied on, and tests check the outcome: the
combiner is called as f(accumulator, element), and a reduction of two elements is not rearranged. Where the
default backend is not a CPU the plain function is used. Not differentiable.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.custom_batching import custom_vmap
from jax.extend.core import jaxpr_as_fun

TWICE = 2

Flat = Callable[..., list[Array]]


def one_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function` with all its outputs computed in one loop on a CPU.

    Arguments:
        function: elementwise in its arguments, pytrees of float scalars of any common batch shape and one
            precision (float32 unless one of them is float64); Python floats among them are constants. Its
            outputs are scalars of that precision (or Python floats). It must close over no traced value: it
            is traced once for each structure of arguments, on scalars.

    Returns:
        A function of the same arguments. Under `jax.vmap` the batch is handled here, so nothing is reordered.
    """
    traced: dict[Any, tuple[Flat, Any]] = {}

    def called(*args: Any) -> Any:
        leaves, tree = jax.tree.flatten(args)
        fixed = tuple(leaf if isinstance(leaf, float) else None for leaf in leaves)
        arrays = [jnp.asarray(leaf) for leaf in leaves if not isinstance(leaf, float)]
        double = any(array.dtype == jnp.float64 for array in arrays)
        dtype = jnp.dtype(jnp.float64 if double else jnp.float32)
        key = (tree, fixed, dtype)
        if key not in traced:
            traced[key] = _trace(function, tree, fixed, len(arrays), dtype)
        flat, outcome = traced[key]
        shape = jnp.broadcast_shapes(*[array.shape for array in arrays])
        results = _batched(flat, outcome.num_leaves)(
            *[jnp.broadcast_to(array.astype(dtype), shape) for array in arrays]
        )
        return jax.tree.unflatten(outcome, results)

    return called


def _trace(
    function: Callable[..., Any], tree: Any, fixed: tuple[float | None, ...], count: int, dtype: Any
) -> tuple[Flat, Any]:
    """`function` from scalars to a list of scalars, traced, and the structure of its result."""
    outcome: list[Any] = []

    def flat(*scalars: Array) -> list[Array]:
        given = iter(scalars)
        filled = [next(given) if leaf is None else leaf for leaf in fixed]
        result, structure = jax.tree.flatten(function(*jax.tree.unflatten(tree, filled)))
        outcome[:] = [structure]
        return [jnp.asarray(value, dtype) for value in result]

    closed = jax.make_jaxpr(flat)(*[jax.ShapeDtypeStruct((), dtype)] * count)
    return jaxpr_as_fun(closed), outcome[0]


def _batched(flat: Flat, count: int) -> Callable[..., list[Array]]:
    """`flat` on arrays of one shape; a vmapped axis becomes one more axis of that shape."""

    @custom_vmap
    def elementwise(*arrays: Array) -> list[Array]:
        if jax.default_backend() == "cpu":
            return _reduced(flat, arrays, count)
        plain = flat
        for _ in arrays[0].shape:
            plain = jax.vmap(plain)
        return plain(*arrays)

    @elementwise.def_vmap
    def rule(size: int, is_batched: list[bool], *arrays: Array) -> tuple[Any, Any]:
        whole = [
            x if batched else jnp.broadcast_to(x, (size, *x.shape))
            for x, batched in zip(arrays, is_batched, strict=True)
        ]
        results = elementwise(*whole)
        return results, [True] * len(results)

    return elementwise


def _reduced(flat: Flat, arrays: tuple[Array, ...], count: int) -> list[Array]:
    operands = [jnp.broadcast_to(x, (TWICE, *x.shape)) for x in arrays]
    operands += [operands[0]] * (count - len(operands))

    def combine(_: Any, element: tuple[Array, ...]) -> tuple[Array, ...]:
        return (*flat(*element[: len(arrays)]), *element[count:])

    start = (jnp.zeros((), arrays[0].dtype),) * len(operands)
    results = lax.optimization_barrier(lax.reduce(tuple(operands), start, combine, (0,)))
    return list(results[:count])
