"""Time offset: the force channel lags the angle or the position by a fixed time.

F(t - D). Signature: in steady cutting the free phase of a trial absorbs it; it shows against a measured angle
at several speeds, and at starts. Confused with a low-pass filter, which takes amplitude too. In a record the
delay is kept in HISTORY steps (a longer one gives NaN: take longer steps).
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

HISTORY = 512


@register
class TimeOffset(AbstractEffect):
    """A pure delay of the sensed force.

    Fields: `delay_s` [] D, s.
    """

    name = "time_offset"
    stage = "sensor"
    strength = "delay_s"
    parameters = {"delay_s": Parameter("s", -0.1, 0.1, 0.0, 5e-3, source="2-20 ms")}
    needs = ("spindle angle",)
    signature = "lag against measured position or angle, amplitude untouched"
    confused_with = {"sensor_lowpass": "a filter also takes amplitude"}

    delay_s: ArrayLike

    def init(self, model: ForceModel) -> Any:
        return jnp.zeros((HISTORY, 3))

    def respond(
        self, state: Any, force: Array, cut: Cut, dt_s: ArrayLike, model: ForceModel
    ) -> tuple[Any, Array]:
        line = jnp.concatenate([force[None], state])
        steps = jnp.maximum(jnp.asarray(self.delay_s) / dt_s, 0.0)
        lower = jnp.clip(jnp.floor(steps), 0, HISTORY - 1).astype(int)
        share = steps - lower
        then = line[lower] * (1.0 - share) + line[lower + 1] * share
        return line[:-1], jnp.where(steps > HISTORY, jnp.nan, then)

    def transfer(self, frequency_hz: ArrayLike, cut: Cut, model: ForceModel) -> Array:
        turn = -2.0 * jnp.pi * jnp.asarray(frequency_hz) * self.delay_s
        return jnp.exp(1.0j * turn)[..., None, None] * jnp.eye(3)
