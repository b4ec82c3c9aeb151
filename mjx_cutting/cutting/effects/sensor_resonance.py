"""Resonance of the transducer: lines near its natural frequency are inflated, at a fixed frequency in Hz.

H(f) = 1 / (1 - r^2 + 2 j zeta r), r = f / f_n, the same on the three axes. Signature: every line near f_n
grows whatever the spindle speed or the pose. Confused with a mode of the robot, which moves with the pose: a
tap test decides.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.coordinates import retuned
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.response import second_order_step, second_order_transfer
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

TYPICAL_HZ = 400.0
BEYOND_HZ = 1e12


@register
class SensorResonance(AbstractEffect):
    """A lightly damped second-order transducer.

    Fields: `frequency_hz` [] natural frequency f_n, Hz; `damping` [] damping ratio zeta, above 0 and below 1.
    """

    name = "sensor_resonance"
    stage = "sensor"
    strength = "frequency_hz"
    parameters = {
        "frequency_hz": Parameter(
            "Hz", 80.0, 1900.0, BEYOND_HZ, TYPICAL_HZ, log=True, source="100-1500 Hz, working knowledge"
        ),
        "damping": Parameter("1", 0.005, 0.5, None, 0.05, log=True, source="0.5-50 %, working knowledge"),
    }
    sharp = ("frequency_hz",)
    signature = "lines near one fixed frequency inflated, whatever the spindle speed or pose"
    confused_with = {"robot_mode": "a robot's mode moves with the pose; a tap test shows the sensor's"}

    frequency_hz: ArrayLike
    damping: ArrayLike

    def init(self, model: ForceModel) -> Any:
        return jnp.zeros((2, 3))

    def respond(
        self, state: Any, force: Array, cut: Cut, dt_s: ArrayLike, model: ForceModel
    ) -> tuple[Any, Array]:
        return second_order_step(state, force, dt_s, self.frequency_hz, self.damping)

    def transfer(self, frequency_hz: ArrayLike, cut: Cut, model: ForceModel) -> Array:
        response = second_order_transfer(frequency_hz, self.frequency_hz, self.damping)
        return response[..., None, None] * jnp.eye(3)

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.log([[share, 0.5] for share in np.geomspace(0.25, 4.5, 10)])

    @classmethod
    def again(cls, coordinates: np.ndarray, tool: Tool) -> np.ndarray:
        return retuned(coordinates, 0)
