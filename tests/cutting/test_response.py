"""The second-order response: exact step, transfer function, and no lag at the middle of a step."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.cutting.response import second_order_step, second_order_transfer

pytestmark = pytest.mark.usefixtures("float64")

NATURAL, DAMPING = 30.0, 0.07


def test_transfer_at_its_landmarks():
    response = second_order_transfer(jnp.array([0.0, NATURAL, 1e5]), NATURAL, DAMPING)
    np.testing.assert_allclose(response[0], 1.0)
    np.testing.assert_allclose(response[1], -0.5j / DAMPING, atol=1e-12)
    assert abs(response[2]) < 1e-6


@pytest.mark.parametrize("steps", [1, 7, 400])
def test_free_decay_is_exact_for_any_step(steps: int):
    state = jnp.array([1.0, 0.0])
    for _ in range(steps):
        state, _ = second_order_step(state, jnp.zeros(()), 0.05 / steps, NATURAL, DAMPING)
    natural = 2.0 * np.pi * NATURAL
    damped = natural * np.sqrt(1.0 - DAMPING**2)
    t = 0.05
    exact = np.exp(-DAMPING * natural * t) * (
        np.cos(damped * t) + DAMPING * natural / damped * np.sin(damped * t)
    )
    np.testing.assert_allclose(state[0], exact, atol=1e-9)


def test_step_response_is_exact_and_so_is_its_mean():
    state, mean = second_order_step(jnp.zeros(2), jnp.ones(()), 0.01, NATURAL, DAMPING)
    fine, total = jnp.zeros(2), 0.0
    for _ in range(2000):
        before = fine[0]
        fine, _ = second_order_step(fine, jnp.ones(()), 0.01 / 2000, NATURAL, DAMPING)
        total += 0.5 * float(before + fine[0]) / 2000
    np.testing.assert_allclose(state, fine, rtol=1e-9)
    np.testing.assert_allclose(mean, total, rtol=1e-6)


@pytest.mark.parametrize("per_cycle", [20, 40])
def test_sampled_response_has_no_lag(per_cycle: int):
    """A sine sampled at the middle of each step comes out as the transfer function says, to second order."""
    frequency = 21.0
    dt = 1.0 / (frequency * per_cycle)
    time = dt * np.arange(per_cycle * 60)

    def one(state: jax.Array, force: jax.Array) -> tuple[jax.Array, jax.Array]:
        return second_order_step(state, force, dt, NATURAL, DAMPING)

    _, seen = jax.lax.scan(one, jnp.zeros(2), jnp.cos(2.0 * np.pi * frequency * time))
    last = np.asarray(seen[-per_cycle:])
    phasor = 2.0 / per_cycle * np.sum(last * np.exp(-2j * np.pi * frequency * time[-per_cycle:]))
    exact = complex(second_order_transfer(frequency, NATURAL, DAMPING))
    assert abs(phasor - exact) / abs(exact) < 3.5 / per_cycle**2
    assert abs(np.angle(phasor / exact)) < 1.0 / per_cycle**2


def test_a_response_far_faster_than_the_step_is_the_force():
    state, mean = second_order_step(jnp.array([3.0, 1.0]), jnp.asarray(5.0), 1e-3, 1e9, 0.05)
    np.testing.assert_allclose([state[0], mean], 5.0, rtol=1e-6)
