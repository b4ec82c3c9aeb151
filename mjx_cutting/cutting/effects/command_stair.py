"""Command stair: the feed is not the nominal one but what the policy last commanded, held over its period.

v = v_nominal + s (v_measured - v_nominal), taken anew at the start of every period. Signature: broadband
below the policy's rate with NULLS at that rate (50 Hz) and its multiples; follows the commands. Confused with
mains pickup, which is there while the robot stands. Needs the measured feed speed; the deviation is in
`Cut.feed_deviation_m_s`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel


@register
class CommandStair(AbstractEffect):
    """Feed held over each period of the policy.

    Fields: `share` [] part s of the measured deviation that the chip follows; `period_s` [] s. Bound by
    `recall`: `held_m_s` [] deviation held, m/s.
    """

    name = "command_stair"
    stage = "spindle"
    strength = "share"
    parameters = {
        "share": Parameter("1", 0.0, 2.0, 0.0, 1.0, source="1 when the measured speed is the true one"),
        "period_s": Parameter("s", 0.001, 1.0, None, 0.0, source="policy rate, 50 Hz"),
    }
    needs = ("feed speed",)
    steady = False
    coupled = True
    signature = "broadband below the policy's rate with nulls at it and its multiples; follows the commands"
    confused_with = {"mains_pickup": "mains is there while the robot stands"}

    share: ArrayLike
    period_s: ArrayLike = 0.02
    held_m_s: ArrayLike | None = None

    def spindle(self, cut: Cut, model: ForceModel) -> Cut:
        held = cut.feed_deviation_m_s if self.held_m_s is None else self.held_m_s
        return cut.replace(feed_speed_m_s=cut.feed_speed_m_s + self.share * jnp.asarray(held))

    def init(self, model: ForceModel) -> Any:
        return jnp.full((), -1.0), jnp.zeros(())

    def recall(self, state: Any, cut: Cut, dt_s: ArrayLike, model: ForceModel) -> CommandStair:
        period, held = state
        now = jnp.floor(jnp.asarray(cut.time_s) / self.period_s + 1e-6)
        return CommandStair(self.share, self.period_s, jnp.where(now == period, held, cut.feed_deviation_m_s))

    def respond(
        self, state: Any, force: Array, cut: Cut, dt_s: ArrayLike, model: ForceModel
    ) -> tuple[Any, Array]:
        now = jnp.floor(jnp.asarray(cut.time_s) / self.period_s + 1e-6)
        held = state[1] if self.held_m_s is None else self.held_m_s
        return (now.astype(state[0].dtype), jnp.asarray(held).astype(state[1].dtype)), force

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 1

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> CommandStair:
        """The share; the period is that of the policy, 20 ms."""
        return cls(coordinates[0])

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[0.5]])

    @classmethod
    def identity(cls, tool: Tool) -> CommandStair:
        return cls(0.0)
