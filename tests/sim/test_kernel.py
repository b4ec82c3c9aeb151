"""One kernel gives what the plain function gives, however it is batched."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.sim import chain, cholesky
from mjx_cutting.sim.kernel import one_kernel


def tangle(x, y, constants):
    """Many shared values, two outputs, a constant among the arguments."""
    a, b = jnp.sin(x) * y, jnp.cos(y) + x
    for _ in range(6):
        a, b = a * b - x, a + b * y
    return {"first": jnp.where(a > b, a, b), "second": (a / (1.0 + b * b), constants["k"] * x)}


def agree(ours, plain, tolerance=1e-6):
    for a, b in zip(jax.tree.leaves(ours), jax.tree.leaves(plain), strict=True):
        np.testing.assert_allclose(np.asarray(a), np.asarray(b), rtol=tolerance, atol=tolerance)


def test_it_equals_the_plain_function_for_any_batching():
    x = jax.random.uniform(jax.random.key(0), (3, 5))
    y = jax.random.uniform(jax.random.key(1), (3, 5))
    constants = {"k": 2.0}

    def single(a, b):
        return one_kernel(tangle)(a, b, constants)

    plain = tangle(x, y, constants)
    agree(one_kernel(tangle)(x, y, constants), plain)
    agree(jax.jit(one_kernel(tangle))(x, y, {"k": jnp.float32(2.0)}), plain)
    agree(jax.vmap(jax.vmap(single))(x, y), plain)
    agree(jax.jit(jax.vmap(jax.vmap(single)))(x, y), plain)
    agree(jax.jit(single)(x[0, 0], y[0, 0]), jax.tree.map(lambda leaf: leaf[0, 0], plain))


def test_an_unbatched_argument_is_shared():
    x = jax.random.uniform(jax.random.key(0), (7,))
    out = jax.vmap(lambda a: one_kernel(tangle)(a, jnp.float32(0.5), {"k": 1.0}))(x)
    agree(out, tangle(x, jnp.full(7, 0.5), {"k": 1.0}))


def test_it_runs_in_a_scan():
    def one(carry, _):
        return one_kernel(lambda a, b: (jnp.sin(a + b), a * 0.5 + b))(*carry), None

    start = (jnp.linspace(0.0, 1.0, 9), jnp.ones(9))
    ours = jax.jit(lambda: jax.lax.scan(one, start, None, length=20)[0])()
    a, b = start
    for _ in range(20):
        a, b = jnp.sin(a + b), a * 0.5 + b
    agree(ours, (a, b), 1e-5)


def test_a_large_graph_compiles_to_one_loop(robot):
    # thousands of shared operations and dozens of outputs: plain XLA makes a loop per output
    q = tuple(jax.random.uniform(jax.random.key(i), (64,)) for i in range(7))

    def work(*q):
        return cholesky.factor(chain.inertia(robot, list(q)).mass)

    compiled = jax.jit(one_kernel(work)).lower(*q).compile()
    agree(compiled(*q), work(*q), 1e-4)
    if jax.default_backend() == "cpu":
        assert compiled.as_text().count(" fusion(") <= 3


@pytest.mark.parametrize("size", [3, 7])
def test_unrolled_cholesky_solves(size):
    rng = np.random.default_rng(size)
    root = rng.normal(size=(size, size))
    matrix = (root @ root.T + size * np.eye(size)).astype(np.float32)
    right = rng.normal(size=size).astype(np.float32)
    rows = [[jnp.asarray(matrix[i, j]) for j in range(i + 1)] for i in range(size)]
    ours = cholesky.solve(cholesky.factor(rows), [jnp.asarray(v) for v in right])
    np.testing.assert_allclose(np.asarray(ours), np.linalg.solve(matrix, right), rtol=2e-5, atol=1e-6)
