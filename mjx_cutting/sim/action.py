"""Actions: five set-points in [-1, 1], mapped to physical ranges and followed at limited rates.

target = low + (a + 1)/2 (high - low), for the gains on the logarithm; the set-point moves toward its target
by at most rate x dt per policy step and never leaves its range, so there is nothing to wind up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from mjx_cutting.sim.config import EnvConfig

NAMES = ("stiffness_x", "stiffness_y", "stiffness_z", "feed_adjustment", "depth")
SIZE = len(NAMES)


@dataclass(frozen=True)
class ActionLimits:
    """Physical meaning of the five actions, in order of `names`.

    Fields:
        names, units: of the physical set-points.
        low, high: [5] physical range; action -1 is low, +1 is high.
        rate: [5] largest rate of change, per second; of the logarithm where `log`.
        log: whether the map is linear in the logarithm.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    rate: tuple[float, ...]
    log: tuple[bool, ...]


def limits(config: EnvConfig) -> ActionLimits:
    """The limits that `config` states."""
    stiffness, feed, depth = config.stiffness_s2, config.feed_adjustment, config.depth_m
    return ActionLimits(
        names=NAMES,
        units=("s^-2", "s^-2", "s^-2", "1", "m"),
        low=(stiffness[0],) * 3 + (feed[0], depth[0]),
        high=(stiffness[1],) * 3 + (feed[1], depth[1]),
        rate=(config.stiffness_rate_s,) * 3 + (config.feed_rate_s, config.depth_rate_m_s),
        log=(True, True, True, False, False),
    )


def internal_range(bounds: ActionLimits) -> tuple[np.ndarray, np.ndarray]:
    """[5] low and high in the coordinates that set-points live in (logarithm of the gains)."""
    low, high = np.asarray(bounds.low), np.asarray(bounds.high)
    log = np.asarray(bounds.log)
    return np.where(log, np.log(np.where(log, low, 1.0)), low), np.where(
        log, np.log(np.where(log, high, 1.0)), high
    )


def follow(setpoint: Array, action: Array, bounds: ActionLimits, dt_s: float) -> Array:
    """[5] set-points after one policy step toward `action` [5]; NaN actions count as 0."""
    low, high = (jnp.asarray(x, float) for x in internal_range(bounds))
    wish = jnp.clip(jnp.where(jnp.isnan(action), 0.0, action), -1.0, 1.0)
    target = low + 0.5 * (wish + 1.0) * (high - low)
    most = jnp.asarray(bounds.rate, float) * dt_s
    return jnp.clip(setpoint + jnp.clip(target - setpoint, -most, most), low, high)


def to_action(physical: Any, bounds: ActionLimits) -> np.ndarray:
    """[..., 5] the action in [-1, 1] that asks for physical set-points [..., 5].

    Raises:
        ValueError: a set-point outside its range.
    """
    value = np.asarray(physical, dtype=float)
    low, high = np.asarray(bounds.low), np.asarray(bounds.high)
    if np.any(value < low - 1e-12) or np.any(value > high + 1e-12):
        raise ValueError(
            f"set-points are {value.tolist()}; expected {low.tolist()} to {high.tolist()} for {bounds.names}"
        )
    inner_low, inner_high = internal_range(bounds)
    log = np.asarray(bounds.log)
    inner = np.where(log, np.log(np.where(log, value, 1.0)), value)
    return np.clip(2.0 * (inner - inner_low) / (inner_high - inner_low) - 1.0, -1.0, 1.0)


def log_start(config: EnvConfig) -> tuple[float, float, float, float, float]:
    """Set-points at reset: start gains, nominal feed, depth at the low end."""
    x, y, z = (math.log(k) for k in config.start_stiffness_s2)
    feed = min(max(0.0, config.feed_adjustment[0]), config.feed_adjustment[1])
    return (x, y, z, feed, config.depth_m[0])
