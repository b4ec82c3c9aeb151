"""Hysteresis: presliding friction of the drive, a force that depends on where the motion last turned back.

LuGre model (Canudas de Wit et al., IEEE Trans. Automatic Control 40 (1995) 419-425), without bristle damping:

    z' = v - |v| z / (d g(v)),   g = 1 + (s - 1) exp(-(v / v_s)^2),   F = F_c z / d + F_v v

v the tool's speed along x, d the presliding distance; integrated exactly over a step. Signature: a loop of
force over position that does not depend on the rate. Confused with a lag of phase, which a sweep of rate
separates. In steady motion it is a bias: what tells it is how it builds up from the start of a trial.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.registry import register

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

_STRIBECK_M_S = 1e-3


@register
class Hysteresis(AbstractEffect):
    """Friction with presliding along the feed.

    Fields: `coulomb_n` [] F_c, N; `presliding_m` [] d, m; `stiction` [] s, static over sliding friction;
    `viscous_n_s_m` [] F_v, N s/m.
    """

    name = "hysteresis"
    stage = "structure"
    strength = "coulomb_n"
    parameters = {
        "coulomb_n": Parameter("N", 0.0, 200.0, 0.0, 5.0, source="working knowledge"),
        "presliding_m": Parameter("m", 1e-7, 1e-2, None, 5e-5, log=True, source="10 um-1 mm at the tool"),
        "stiction": Parameter("1", 0.5, 3.0, 1.0, 0.0, source="1-2"),
        "viscous_n_s_m": Parameter("N s/m", 0.0, 1e4, 0.0, 100.0),
    }
    steady = False
    signature = "loop of force over position, independent of rate"
    confused_with = {"time_offset": "a lag grows with the rate; friction does not"}

    coulomb_n: ArrayLike
    presliding_m: ArrayLike
    stiction: ArrayLike
    viscous_n_s_m: ArrayLike

    def init(self, model: ForceModel) -> Any:
        return jnp.zeros(())

    def respond(
        self, state: Any, force: Array, cut: Cut, dt_s: ArrayLike, model: ForceModel
    ) -> tuple[Any, Array]:
        speed = jnp.asarray(cut.feed_speed_m_s + cut.vibration_x_m_s)
        level = 1.0 + (self.stiction - 1.0) * jnp.exp(-((speed / _STRIBECK_M_S) ** 2))
        slid = jnp.sign(speed) * level
        after = slid + (state - slid) * jnp.exp(-jnp.abs(speed) * dt_s / (self.presliding_m * level))
        drag = self.coulomb_n * 0.5 * (state + after) + self.viscous_n_s_m * speed
        return after, force.at[0].add(-drag)
