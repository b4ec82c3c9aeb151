"""What a known anti-alias filter and a helix do to each line of straight teeth."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.trials.dataset import AntiAlias, Sensor

_LONG = 4.0


def line_gain(sensor: Sensor, speed_rev_s: np.ndarray[Any, Any], orders: int) -> np.ndarray[Any, Any]:
    """[R, orders + 1] complex response of the known anti-alias filter at each order.

    Arguments: sensor; `speed_rev_s` [R] spindle speeds; highest order.
    """
    return filter_gain(sensor.anti_alias, np.multiply.outer(speed_rev_s, np.arange(orders + 1)))


def helix_gain(width_m: ArrayLike, diameter_m: ArrayLike, helix_rad: ArrayLike, orders: int) -> Array:
    """[R, orders + 1] mean of exp(-i n lag) over widths of cut [R], N per N of straight teeth."""
    half = _half_lag(width_m, diameter_m, helix_rad, orders)
    return jnp.sinc(half / jnp.pi) * jnp.exp(-1j * half)


def slice_gain(width_m: ArrayLike, diameter_m: ArrayLike, helix_rad: ArrayLike, orders: int) -> Array:
    """[R, orders + 1] the same about the middle of widths [R]: of slices each of which is in its place."""
    return jnp.sinc(_half_lag(width_m, diameter_m, helix_rad, orders) / jnp.pi)


def _half_lag(width_m: ArrayLike, diameter_m: ArrayLike, helix_rad: ArrayLike, orders: int) -> Array:
    return jnp.outer(jnp.asarray(width_m) * jnp.tan(helix_rad) / diameter_m, jnp.arange(orders + 1))


def filter_delay_s(sensor: Sensor) -> float:
    """[] by how much later what is slow against the known anti-alias filter is seen behind it."""
    alias = sensor.anti_alias
    if alias is None or alias.zero_phase:
        return 0.0
    return float(-np.sum((1.0 / _poles(alias)).real) / (2.0 * np.pi * alias.hz))


def heard(value: np.ndarray[Any, Any], alias: AntiAlias | None, rate_hz: float) -> np.ndarray[Any, Any]:
    """[T] what a factor [T] of a force that is slow itself is behind a known filter; before and after the
    record it is as at its ends."""
    if alias is None:
        return value
    padded = np.pad(value, round(_LONG * rate_hz / alias.hz), mode="edge")
    gain = filter_gain(alias, np.fft.rfftfreq(len(padded), 1.0 / rate_hz))
    beside = (len(padded) - len(value)) // 2
    return np.fft.irfft(np.fft.rfft(padded) * gain, len(padded))[beside : beside + len(value)]


def _poles(alias: AntiAlias) -> np.ndarray[Any, Any]:
    """[order] poles of a Butterworth low-pass of corner 1 rad/s."""
    return np.exp(1j * np.pi * (2 * np.arange(1, alias.order + 1) + alias.order - 1) / (2 * alias.order))


def filter_gain(alias: AntiAlias | None, frequency: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """[...] complex response of a filter at frequencies, Hz; 1 without one."""
    if alias is None:
        return np.ones_like(frequency, dtype=complex)
    poles = _poles(alias)
    gain = np.prod(-poles / (1j * frequency[..., None] / alias.hz - poles), axis=-1)
    return np.abs(gain) ** 2 + 0j if alias.zero_phase else gain
