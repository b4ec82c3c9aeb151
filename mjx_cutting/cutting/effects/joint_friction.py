"""Joint friction: a force told from joint torques contains the friction of the joint that carries the feed.

F = F_c sgn(qd) + F_v qd, against the motion along x, qd the velocity of that joint. Signature: flips where
the joint reverses; constant at constant feed, where nothing tells it from a bias. Confused with bias: reverse
the feed. A sensor at the wrist does not see it. Smoothed near standstill.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.registry import register

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

_STICK_RAD_S = 1e-4


@register
class JointFriction(AbstractEffect):
    """Coulomb and viscous friction of one joint, as a force at the tool.

    Fields: `coulomb_n` [] F_c, N; `viscous_n_s_rad` [] F_v, N s/rad.
    """

    name = "joint_friction"
    stage = "structure"
    strength = "coulomb_n"
    parameters = {
        "coulomb_n": Parameter("N", 0.0, 200.0, 0.0, 5.0, source="working knowledge"),
        "viscous_n_s_rad": Parameter("N s/rad", 0.0, 1000.0, 0.0, 10.0, source="working knowledge"),
    }
    needs = ("joint velocity",)
    signature = "force along the feed that flips where the joint reverses"
    confused_with = {"sensor bias": "reverse the feed: friction flips, a bias does not"}

    coulomb_n: ArrayLike
    viscous_n_s_rad: ArrayLike

    def sense(self, force: Array, cut: Cut, model: ForceModel) -> Array:
        velocity = jnp.asarray(cut.joint_velocity_rad_s)
        drag = self.coulomb_n * jnp.tanh(velocity / _STICK_RAD_S) + self.viscous_n_s_rad * velocity
        return force - jnp.asarray(drag)[..., None] * jnp.array([1.0, 0.0, 0.0])
