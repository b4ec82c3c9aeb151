"""Sensor low-pass: the transducer's amplifier is a Butterworth filter that nobody told of.

Orders 1 to 4, the same on the three axes, as a chain of a first-order and second-order sections. Signature:
loss and lag at high frequency, at a fixed frequency in Hz; the mean exact. Confused with a helix, whose loss
goes with order; order 2 IS a resonance of damping 0.707, so there the answer is ambiguous.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.response import second_order_step, second_order_transfer
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

BEYOND_HZ = 1e12
TYPICAL_HZ = 100.0


@register
class SensorLowpass(AbstractEffect):
    """Butterworth low-pass.

    Fields: `cutoff_hz` [] Hz; `order` [] 1, 2, 3 or 4.
    """

    name = "sensor_lowpass"
    stage = "sensor"
    strength = "cutoff_hz"
    damps = True
    parameters = {
        "cutoff_hz": Parameter("Hz", 5.0, 2000.0, BEYOND_HZ, TYPICAL_HZ, log=True, source="20-250 Hz"),
        "order": Parameter("1", 0.0, 5.0, None, 0.0, source="1-4", whole=True),
    }
    signature = "loss and lag above a fixed frequency; mean exact"
    confused_with = {
        "helix_lag": "a helix loses with order, not with frequency: change the speed",
        "sensor_resonance": "order 2 is a resonance of damping 0.707",
    }

    cutoff_hz: ArrayLike
    order: ArrayLike

    def init(self, model: ForceModel) -> Any:
        return jnp.zeros((5, 3))

    def respond(
        self, state: Any, force: Array, cut: Cut, dt_s: ArrayLike, model: ForceModel
    ) -> tuple[Any, Array]:
        odd, (use_first, use_second), (first, second) = self._sections()
        rate = 2.0 * jnp.pi * jnp.asarray(self.cutoff_hz)
        fade = jnp.exp(-rate * dt_s)
        offset = state[0] - force
        simple = force + offset * (1.0 - fade) / (rate * dt_s)
        after = force + offset * fade
        force = jnp.where(odd, simple, force)
        pair, passed = second_order_step(state[1:3], force, dt_s, self.cutoff_hz, first)
        force = jnp.where(use_first, passed, force)
        last, passed = second_order_step(state[3:5], force, dt_s, self.cutoff_hz, second)
        return jnp.concatenate([after[None], pair, last]), jnp.where(use_second, passed, force)

    def transfer(self, frequency_hz: ArrayLike, cut: Cut, model: ForceModel) -> Array:
        odd, (use_first, use_second), (first, second) = self._sections()
        ratio = jnp.asarray(frequency_hz) / self.cutoff_hz
        gain = jnp.where(odd, 1.0 / (1.0 + 1.0j * ratio), 1.0)
        gain = gain * jnp.where(use_first, second_order_transfer(frequency_hz, self.cutoff_hz, first), 1.0)
        gain = gain * jnp.where(use_second, second_order_transfer(frequency_hz, self.cutoff_hz, second), 1.0)
        return gain[..., None, None] * jnp.eye(3)

    def _sections(self) -> tuple[Array, tuple[Array, Array], tuple[Array, Array]]:
        """Whether a first-order section and each of the two second-order ones is used, and their damping."""
        order = jnp.clip(jnp.round(jnp.asarray(self.order)), 1, 4)
        first = jnp.where(order == 2, np.sqrt(0.5), jnp.where(order == 3, 0.5, np.cos(np.pi / 8)))
        return (order == 1) | (order == 3), (order >= 2, order == 4), (first, jnp.asarray(np.sin(np.pi / 8)))

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> SensorLowpass:
        """Coordinates: log(cutoff / 100 Hz), and half the order, rounded."""
        return cls(TYPICAL_HZ * jnp.exp(coordinates[0]), jnp.clip(jnp.round(2.0 * coordinates[1]), 1.0, 4.0))

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        corners = np.geomspace(30.0, 600.0, 6)
        return np.asarray([[np.log(hz / TYPICAL_HZ), 0.5 * n] for hz in corners for n in (1, 2, 3, 4)])

    @classmethod
    def again(cls, coordinates: np.ndarray, tool: Tool) -> np.ndarray:
        """The other orders, none of which a descent changes to. Of a lower one, which loses more before its
        cutoff, that lies lower too, of a higher one higher."""
        order = np.clip(np.round(2.0 * coordinates[1]), 1, 4)
        others = ((n, 2.0 ** (share * np.sign(n - order))) for n in (1, 2, 3, 4) for share in (0, 1))
        ways = [[coordinates[0] + np.log(factor), 0.5 * n] for n, factor in others if n != order]
        return np.asarray(ways)

    @classmethod
    def identity(cls, tool: Tool) -> SensorLowpass:
        return cls(BEYOND_HZ, 2.0)
