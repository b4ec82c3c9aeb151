"""A second-order response, x'' + 2 zeta w x' + w^2 x = w^2 F: its transfer function and its exact step.

H(f) = 1 / (1 - r^2 + 2 j zeta r), r = f / f_n. The step holds the force over dt (zero-order hold) and is
exact for that, so it is stable for any dt. What it returns is the MEAN response over the step: then a force
sampled at the middle of a step gives the response there, without a lag, to second order in dt; and a response
far faster than the step is the force itself. Underdamped only: 0 < zeta < 1.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike


def second_order_transfer(frequency_hz: ArrayLike, natural_hz: ArrayLike, damping: ArrayLike) -> Array:
    """[...] complex response at each frequency, 1 at zero frequency."""
    ratio = jnp.asarray(frequency_hz) / natural_hz
    return 1.0 / (1.0 - ratio**2 + 2.0j * jnp.asarray(damping) * ratio)


def second_order_step(
    state: Array, force: Array, dt_s: ArrayLike, natural_hz: ArrayLike, damping: ArrayLike
) -> tuple[Array, Array]:
    """Advance the response by one step.

    Arguments:
        state: [2, ...] response x and its rate x', at the start of the step.
        force: [...] input held over the step.
        dt_s: [] step, s.
        natural_hz, damping: [...] undamped natural frequency, Hz, and damping ratio; may be those of each
            entry of `force`.

    Returns:
        state at the end of the step and the mean response over it, [...].
    """
    natural = 2.0 * jnp.pi * jnp.asarray(natural_hz)
    damped = natural * jnp.sqrt(1.0 - jnp.asarray(damping) ** 2)
    fade = jnp.exp(-jnp.asarray(damping) * natural * dt_s)
    cosine, sine = jnp.cos(damped * dt_s), jnp.sin(damped * dt_s)
    offset, rate = state[0] - force, state[1]
    lean = damping * natural / damped
    after = fade * ((cosine + lean * sine) * offset + sine / damped * rate)
    speed = fade * (-(natural**2) / damped * sine * offset + (cosine - lean * sine) * rate)
    shift = (speed - rate) / natural + 2.0 * damping * (after - offset)
    return jnp.stack([after + force, speed]), force - shift / (natural * dt_s)


def inertial_transfer(frequency_hz: ArrayLike, natural_hz: ArrayLike, damping: ArrayLike) -> Array:
    """[...] complex r^2 / (1 - r^2 + 2 j zeta r): minus the response's acceleration over w^2."""
    ratio = jnp.asarray(frequency_hz) / natural_hz
    return ratio**2 * second_order_transfer(frequency_hz, natural_hz, damping)


def inertial_step(
    state: Array, force: Array, dt_s: ArrayLike, natural_hz: ArrayLike, damping: ArrayLike
) -> tuple[Array, Array]:
    """As `second_order_step`, returning minus the mean acceleration of the response over w^2, [...]."""
    after, mean = second_order_step(state, force, dt_s, natural_hz, damping)
    natural = 2.0 * jnp.pi * jnp.asarray(natural_hz)
    return after, mean + 2.0 * damping * (after[0] - state[0]) / (natural * dt_s) - force
