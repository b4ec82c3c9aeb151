"""Motion of the tool's centre within a turn, as measured: the chip follows it, the sensor feels it.

A compliant arm gives way to the once-per-turn force of a runout until hardly any of it is left in the force;
what the teeth cut is known only together with where the tool was. Lines at orders 1 to K of the tool's angle,

    u(angle) = Re(2 sum over n of lines_n exp(i n angle)),      alike in every turn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
from jax import Array

from mjx_cutting.cutting.chip import Cutter
from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel


class CentreMotion(AbstractEffect):
    """A known motion, not an effect to be found: it is not registered.

    Fields: `lines` [K, 3] complex, in x, y and z, m; the chip follows the first two.
    """

    name = "centre_motion"
    stage = "chip"

    lines: Array

    def cutter(self, cutter: Cutter, model: ForceModel) -> Cutter:
        return cutter._replace(path=self.lines[:, :2], even=False)


def felt_on(cut: Cut, lines: Array, angles: int) -> Cut:
    """The cut with the acceleration of the motion [K, 3] in `gravity_x_m_s2` and its sisters, [angles] each
    at even angles of a turn, as an effect of the mass that the sensor carries reads it."""
    order = jnp.arange(1, lines.shape[0] + 1)
    angle = cut.angle_rad + 2.0 * jnp.pi / angles * jnp.arange(angles)
    rate = 2.0 * jnp.pi * jnp.asarray(cut.spindle_speed_rev_s) * order
    less = 2.0 * jnp.real(jnp.exp(1j * angle[:, None] * order) @ (rate[:, None] ** 2 * lines))
    return cut.replace(gravity_x_m_s2=less[:, 0], gravity_y_m_s2=less[:, 1], gravity_z_m_s2=less[:, 2])
