"""Clamp mode: the sheet swings along the normal, at a frequency that depends on where it is cut.

The force felt along y is F_y + mu r^2 / (1 - r^2 + 2 j zeta r) F_y, r = f / f(s), at f(s) = f_0 (1 + g s +
c s^2); for a plate on a dynamometer mu is 1 (it sees K y + C y'). A sheet held at both ends is softest
between them: g negative, c positive. Signature: normal axis only, 20-500 Hz, the frequency moves along the
path. Confused with a mode of the robot, which moves with the pose; where gradient and curvature are nil the
two are one. Lines of a whole trial see the mean over its path: trials of other length or feed tell the
gradient, and what changes within a trial is for pieces of it to show.
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
class ClampMode(AbstractEffect):
    """One mode of the sheet.

    Fields: `mass_ratio` [] mu, strength; `frequency_hz` [] f_0 at position 0, Hz; `gradient_1_m` [] relative
    change of the frequency per metre of path; `damping` []; `curvature_1_m2` [] change per square metre.
    """

    name = "clamp_mode"
    stage = "structure"
    strength = "mass_ratio"
    parameters = {
        "mass_ratio": Parameter("1", 0.0, 2.0, 0.0, 0.3, source="1 for a plate on a dynamometer"),
        "frequency_hz": Parameter("Hz", 10.0, 1000.0, None, 100.0, log=True, source="20-500 Hz"),
        "gradient_1_m": Parameter("1/m", -50.0, 50.0, 0.0, 3.0),
        "damping": Parameter("1", 0.002, 0.3, None, 0.03, log=True),
        "curvature_1_m2": Parameter("1/m^2", -2000.0, 2000.0, 0.0, 100.0),
    }
    telling = ("gradient_1_m", "curvature_1_m2")
    by_position = True
    only_axis = 1
    sharp = ("frequency_hz",)
    signature = "normal axis only, at a frequency that varies with position"
    confused_with = {"robot_mode": "a robot's mode moves with the pose, not along the path"}

    mass_ratio: ArrayLike
    frequency_hz: ArrayLike
    gradient_1_m: ArrayLike
    damping: ArrayLike
    curvature_1_m2: ArrayLike = 0.0

    def init(self, model: ForceModel) -> Any:
        return jnp.zeros(2)

    def respond(
        self, state: Any, force: Array, cut: Cut, dt_s: ArrayLike, model: ForceModel
    ) -> tuple[Any, Array]:
        state, felt = inertial_step(state, force[1], dt_s, self._natural_hz(cut), self.damping)
        return state, force.at[1].add(self.mass_ratio * felt)

    def transfer(self, frequency_hz: ArrayLike, cut: Cut, model: ForceModel) -> Array:
        felt = self.mass_ratio * inertial_transfer(frequency_hz, self._natural_hz(cut), self.damping)
        return jnp.eye(3) + felt[..., None, None] * jnp.diag(jnp.array([0.0, 1.0, 0.0]))

    def _natural_hz(self, cut: Cut) -> Array:
        place = jnp.asarray(cut.position_m)
        factor = 1.0 + place * (self.gradient_1_m + place * self.curvature_1_m2)
        return jnp.asarray(self.frequency_hz) * jnp.maximum(factor, 0.05)

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> ClampMode:
        """Coordinates: mass ratio in units of 0.3, log(f_0 / 100 Hz), gradient in 1/m, log(zeta / 3 %),
        curvature in units of 100 1/m^2."""
        ratio, frequency, gradient, damping, curvature = coordinates
        return cls(
            0.3 * ratio, 100.0 * jnp.exp(frequency), gradient, 0.03 * jnp.exp(damping), 100.0 * curvature
        )

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        frequencies = np.log(np.geomspace(20.0, 450.0, 28) / 100.0)
        still = [[1.5, f, 0.0, 0.0, 0.0] for f in frequencies]
        moving = [[0.5, f, slope, 0.0, 0.0] for f in frequencies[::2] for slope in (-7.0, -3.0, 3.0, 7.0)]
        return np.asarray([*still, *moving])

    @classmethod
    def again(cls, coordinates: np.ndarray, tool: Tool) -> np.ndarray:
        return retuned(coordinates, 1)

    @classmethod
    def identity(cls, tool: Tool) -> ClampMode:
        return cls(0.0, 100.0, 0.0, 0.03)
