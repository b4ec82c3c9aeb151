"""Mains pickup: the sensor's cable picks up the mains.

A sine of 50 or 60 Hz on each axis, by the time of the trial. For its harmonics give the model several.
Signature: a fixed frequency, cutting or not, speed or not. Confused with the stair of the commands, whose
spectrum has nulls there: let the robot stand.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.coordinates import polar
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel


@register
class MainsPickup(AbstractEffect):
    """One line of the mains.

    Fields: `amplitude_n` [3] of each axis, N; `phase_rad` [3] of each axis at time 0, rad; `frequency_hz` [].
    """

    name = "mains_pickup"
    stage = "sensor"
    strength = "amplitude_n"
    parameters = {
        "amplitude_n": Parameter("N", 0.0, 100.0, 0.0, 0.5, length=3, source="working knowledge"),
        "phase_rad": Parameter("rad", -np.pi, np.pi, None, 0.0, length=3),
        "frequency_hz": Parameter("Hz", 10.0, 1000.0, None, 0.0, source="50 or 60 Hz, and multiples"),
    }
    steady = False
    signature = "a fixed 50 or 60 Hz, cutting or not"
    confused_with = {"command_stair": "let the robot stand: mains stays"}

    amplitude_n: ArrayLike
    phase_rad: ArrayLike
    frequency_hz: ArrayLike

    def sense(self, force: Array, cut: Cut, model: ForceModel) -> Array:
        turn = 2.0 * jnp.pi * self.frequency_hz * jnp.asarray(cut.time_s)
        return force + jnp.asarray(self.amplitude_n) * jnp.cos(turn[..., None] + jnp.asarray(self.phase_rad))

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> MainsPickup:
        """Coordinates: cosine and sine amplitude of each axis in 0.5 N, and frequency / 10 Hz - 5."""
        amplitude, phase = polar(coordinates[:3], coordinates[3:6])
        return cls(0.5 * amplitude, phase, 50.0 + 10.0 * coordinates[6])

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[0.5] * 3 + [0.0] * 3 + [0.0], [0.5] * 3 + [0.0] * 3 + [1.0]])

    @classmethod
    def identity(cls, tool: Tool) -> MainsPickup:
        return cls(jnp.zeros(3), jnp.zeros(3), 50.0)
