"""Resonance of the transducer: lines near its natural frequency are inflated, at a fixed frequency in Hz.

H(f) = 1 / (1 - r^2 + 2 j zeta r), r = f / f_n, of x. Along the tool's axis a transducer is often stiffer or
softer, and across the feed as well: there frequency and damping are multiples of those. One that resonates
far beyond all that is heard is stiff there, and passes the force as it is. Signature: every line near f_n
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
STIFF = 1e6
"""Ratio of frequencies along an axis on which the transducer does not resonate."""
_MOST = 10.0 * STIFF


@register
class SensorResonance(AbstractEffect):
    """A lightly damped second-order transducer.

    Fields: `frequency_hz` [] natural frequency f_n, Hz; `damping` [] damping ratio zeta, above 0 and below 1;
    `axial_frequency_ratio`, `axial_damping_ratio` [] times these, they are those of z, and times
    `lateral_frequency_ratio`, `lateral_damping_ratio` [] those of y; 1 where all axes are alike, a frequency
    ratio of `STIFF` where an axis does not resonate. A fit begins with all alike.
    """

    name = "sensor_resonance"
    stage = "sensor"
    strength = "frequency_hz"
    parameters = {
        "frequency_hz": Parameter(
            "Hz",
            80.0,
            6000.0,
            BEYOND_HZ,
            TYPICAL_HZ,
            log=True,
            source="100-1500 Hz at a robot's wrist, to 5 kHz under a plate on a table, working knowledge",
        ),
        "damping": Parameter("1", 0.005, 0.5, None, 0.05, log=True, source="0.5-50 %, working knowledge"),
        "axial_frequency_ratio": Parameter(
            "1", 0.25, _MOST, 1.0, log=True, source="to 4, working knowledge; 1e6: stiff"
        ),
        "axial_damping_ratio": Parameter("1", 0.1, 10.0, 1.0, log=True, source="working knowledge"),
        "lateral_frequency_ratio": Parameter(
            "1", 0.25, _MOST, 1.0, log=True, source="to 4, working knowledge; 1e6: stiff"
        ),
        "lateral_damping_ratio": Parameter("1", 0.1, 10.0, 1.0, log=True, source="working knowledge"),
    }
    sharp = ("frequency_hz",)
    signature = "lines near one fixed frequency inflated, whatever the spindle speed or pose"
    confused_with = {"robot_mode": "a robot's mode moves with the pose; a tap test shows the sensor's"}

    frequency_hz: ArrayLike
    damping: ArrayLike
    axial_frequency_ratio: ArrayLike = 1.0
    axial_damping_ratio: ArrayLike = 1.0
    lateral_frequency_ratio: ArrayLike = 1.0
    lateral_damping_ratio: ArrayLike = 1.0

    def init(self, model: ForceModel) -> Any:
        return jnp.zeros((2, 3))

    def respond(
        self, state: Any, force: Array, cut: Cut, dt_s: ArrayLike, model: ForceModel
    ) -> tuple[Any, Array]:
        return second_order_step(state, force, dt_s, *self._by_axis())

    def transfer(self, frequency_hz: ArrayLike, cut: Cut, model: ForceModel) -> Array:
        response = second_order_transfer(jnp.asarray(frequency_hz)[..., None], *self._by_axis())
        return response[..., None] * jnp.eye(3)

    def _by_axis(self) -> tuple[Array, Array]:
        """[3] natural frequency, Hz, and [3] damping ratio of each axis."""
        frequency = jnp.stack([1.0, self.lateral_frequency_ratio, self.axial_frequency_ratio])
        damping = jnp.stack([1.0, self.lateral_damping_ratio, self.axial_damping_ratio])
        return jnp.asarray(self.frequency_hz) * frequency, jnp.asarray(self.damping) * damping

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 2

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> SensorResonance:
        """Coordinates: log(f_n / 400 Hz), log(zeta / 5 %)."""
        return cls(TYPICAL_HZ * jnp.exp(coordinates[0]), 0.05 * jnp.exp(coordinates[1]))

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.log([[share, 0.5] for share in np.geomspace(0.25, 13.5, 14)])

    @classmethod
    def again(cls, coordinates: np.ndarray, tool: Tool) -> np.ndarray:
        return retuned(coordinates, 0)
