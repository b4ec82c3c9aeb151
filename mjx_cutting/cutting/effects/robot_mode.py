"""Robot mode: the arm swings under the cutting force, and the sensor at its wrist feels the tool's inertia.

M X'' + C X' + K X = F along one direction of the cutting plane; the wrist sensor sees F - m_tool X'', that is

    F + mu r^2 / (1 - r^2 + 2 j zeta r) (u . F) u,   r = f / f_n, mu = m_tool / M

Signature: a fixed frequency, 7-250 Hz, damping 2-8 % (published for six-axis arms); dependent on pose;
elliptical in x-y; rings at entry. Confused with a resonance of the sensor, which does not move with the pose.
Linear, one mode; an arm swings in more than one direction, so tracing looks for two.
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
from mjx_cutting.cutting.response import inertial_step, inertial_transfer
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel


@register
class RobotMode(AbstractEffect):
    """One mode of the arm as a wrist sensor sees it.

    Fields: `mass_ratio` [] mu, tool mass over modal mass; `frequency_hz`, `damping` [] of the mode;
    `direction_rad` [] of its motion from x towards y, rad.
    """

    name = "robot_mode"
    stage = "structure"
    strength = "mass_ratio"
    parameters = {
        "mass_ratio": Parameter("1", 0.0, 2.0, 0.0, 0.2, source="tool 1-3 kg, modal mass 2-30 kg"),
        "frequency_hz": Parameter("Hz", 5.0, 300.0, None, 40.0, log=True, source="7-250 Hz published"),
        "damping": Parameter("1", 0.005, 0.3, None, 0.04, log=True, source="2-8 % published"),
        "direction_rad": Parameter("rad", -np.pi, np.pi, None, 0.0),
    }
    sharp = ("frequency_hz",)
    most = 2
    signature = "lines near a fixed frequency changed along one direction, by the pose; rings at entry"
    confused_with = {"sensor_resonance": "the sensor's does not move with the pose; a tap test shows it"}

    mass_ratio: ArrayLike
    frequency_hz: ArrayLike
    damping: ArrayLike
    direction_rad: ArrayLike

    def init(self, model: ForceModel) -> Any:
        return jnp.zeros(2)

    def respond(
        self, state: Any, force: Array, cut: Cut, dt_s: ArrayLike, model: ForceModel
    ) -> tuple[Any, Array]:
        along = self._direction()
        state, felt = inertial_step(state, along @ force, dt_s, self.frequency_hz, self.damping)
        return state, force + self.mass_ratio * felt * along

    def transfer(self, frequency_hz: ArrayLike, cut: Cut, model: ForceModel) -> Array:
        along = self._direction()
        felt = self.mass_ratio * inertial_transfer(frequency_hz, self.frequency_hz, self.damping)
        return jnp.eye(3) + felt[..., None, None] * jnp.outer(along, along)

    def _direction(self) -> Array:
        angle = jnp.asarray(self.direction_rad)
        return jnp.stack([jnp.cos(angle), jnp.sin(angle), jnp.zeros_like(angle)])

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> RobotMode:
        """Coordinates: mass ratio in units of 0.2, log(f / 40 Hz), log(zeta / 4 %), direction in rad."""
        ratio, frequency, damping, direction = coordinates
        return cls(0.2 * ratio, 40.0 * jnp.exp(frequency), 0.04 * jnp.exp(damping), direction)

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray(
            [
                [mass, np.log(f / 40.0), 0.0, a]
                for mass in (0.5, 2.5)
                for f in np.geomspace(8.0, 280.0, 12)
                for a in np.linspace(0.0, 0.75 * np.pi, 4)
            ]
        )

    @classmethod
    def again(cls, coordinates: np.ndarray, tool: Tool) -> np.ndarray:
        return retuned(coordinates, 1)
