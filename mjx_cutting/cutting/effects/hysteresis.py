"""Hysteresis: presliding friction of a drive, a force that depends on where the motion last turned back.

LuGre model (Canudas de Wit et al., IEEE Trans. Automatic Control 40 (1995) 419-425), without bristle damping,
with the loop of Bouc and Wen (Wen, J. Eng. Mech. Div. ASCE 102 (1976) 249-263, n = 1), z in units of d:

    z' = (v - |v| (beta + (1 - beta) sgn(v z)) z / g(v)) / d,   g = 1 + (s - 1) exp(-(v / v_s)^2)
    F = F_c z + F_v v

v the tool's speed along x, or of a drive across the path along y, d the presliding distance; integrated
exactly over a step. Signature: a loop of force over position that does not depend on the rate. Confused with
a lag of phase, which a sweep of rate separates. In steady motion it is a bias: what tells it is how it builds
up from the start of a trial.
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
_STRAIGHT = 1e-6


def strained(strain: ArrayLike, way: ArrayLike, beta: ArrayLike) -> Array:
    """[...] strain of contacts, -1 to 1, after a way forth, in presliding distances, from the `strain` it
    began with: by which the contacts give way from -1 to 0 as 1 + (2 beta - 1) |z|, from 0 to 1 as 1 - z."""
    from_0 = jnp.maximum(jnp.asarray(strain), 0.0)
    back = jnp.maximum(-jnp.asarray(strain), 0.0)
    stiffer = 2.0 * jnp.asarray(beta) - 1.0
    stiffer = jnp.where(jnp.abs(stiffer) < _STRAIGHT, _STRAIGHT, stiffer)
    to_0 = jnp.log1p(stiffer * back) / stiffer
    beyond = jnp.maximum(jnp.asarray(way) - to_0, 0.0)
    until = jnp.minimum(jnp.asarray(way), to_0)
    short = -back * jnp.exp(-stiffer * until) - jnp.expm1(-stiffer * until) / stiffer
    return jnp.where(beyond > 0.0, 1.0 + (from_0 - 1.0) * jnp.exp(-beyond), short + from_0)


@register
class Hysteresis(AbstractEffect):
    """Friction with presliding of one drive.

    Fields: `coulomb_n` [] F_c, N; `presliding_m` [] d, m; `stiction` [] s, static over sliding friction;
    `viscous_n_s_m` [] F_v, N s/m; `across` [] 0 where the drive is that of the feed, 1 where it is that
    across the path; `beta` [] how much stiffer than at no force the contacts are where the motion has turned
    back, 1 of LuGre's, 0.5 of such as do not stiffen.
    """

    name = "hysteresis"
    stage = "structure"
    strength = "coulomb_n"
    parameters = {
        "coulomb_n": Parameter("N", 0.0, 200.0, 0.0, 5.0, source="working knowledge"),
        "presliding_m": Parameter("m", 1e-7, 1e-2, None, 5e-5, log=True, source="10 um-1 mm at the tool"),
        "stiction": Parameter("1", 0.5, 3.0, 1.0, 0.0, source="1-2"),
        "viscous_n_s_m": Parameter("N s/m", 0.0, 1e4, 0.0, 100.0),
        "across": Parameter("1", 0.0, 1.0, None, 0.0, source="0 or 1", whole=True),
        "beta": Parameter("1", 0.4, 1.1, None, 1.0, log=True, source="0.5 (as much as gamma) to 1"),
    }
    steady = False
    signature = "loop of force over position, independent of rate"
    confused_with = {"time_offset": "a lag grows with the rate; friction does not"}

    coulomb_n: ArrayLike
    presliding_m: ArrayLike
    stiction: ArrayLike
    viscous_n_s_m: ArrayLike
    across: ArrayLike = 0.0
    beta: ArrayLike = 1.0

    def init(self, model: ForceModel) -> Any:
        return jnp.zeros(())

    def respond(
        self, state: Any, force: Array, cut: Cut, dt_s: ArrayLike, model: ForceModel
    ) -> tuple[Any, Array]:
        across = jnp.asarray(self.across)
        speed = jnp.where(across > 0.5, cut.vibration_y_m_s, cut.feed_speed_m_s + cut.vibration_x_m_s)
        level = 1.0 + (self.stiction - 1.0) * jnp.exp(-((speed / _STRIBECK_M_S) ** 2))
        way = jnp.abs(speed) * dt_s / (self.presliding_m * level)
        after = strained(state * jnp.sign(speed) / level, way, self.beta) * jnp.sign(speed) * level
        after = jnp.where(speed == 0.0, state, after)
        drag = self.coulomb_n * 0.5 * (state + after) + self.viscous_n_s_m * speed
        return after, force.at[:2].add(-drag * jnp.stack([1.0 - across, across]))
