"""Regenerative chatter: a tooth cuts the wave that the tooth before it left, and the wave may grow.

M x'' + C x' + K x = F on two axes; a tooth cuts down to the highest surface that the passes before it left,

    h_j = min over m >= 1 of [ m c sin th_j + (x - x_m) sin th_j + (y - y_m) cos th_j ]

with x_m, y_m where the tool was when the m-th tooth before passed. While all teeth cut, m = 1 is the least
and the equation linear: Altintas and Budak, CIRP Annals 44 (1995) 357-362; Insperger and Stepan, J. Sound and
Vibration 295 (2006). Once teeth leave the sheet, the passes further back hold the wave at a few times the
feed (Tlusty and Ismail, CIRP Annals 30 (1981) 299-304). Signature: lines at f_c + k f_t with f_c no multiple
of the spindle frequency, above a threshold of depth; exactly f_t / 2 in flip lobes. Confused with a forced
resonance: shift the speed by 3 %.

Its memory holds HISTORY steps of displacement, so the tooth period must be at most that many steps (beyond it
the force is NaN: take longer steps or fewer samples) and should be at least about 20 of them; the natural
period at least about 30. As many passes are looked back at as the memory holds, at most the teeth or PASSES.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.chip import (
    Chip,
    Cutter,
    carried_over,
    earlier_passes,
    least,
    left_standing,
    touching,
)
from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.response import second_order_step

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

HISTORY = 2048
PASSES = 8
_NO_SURFACE_M = 1e3


@register
class RegenerativeChatter(AbstractEffect):
    """A flexible tool, one mode a radial axis, whose displacement feeds back into the chip.

    Fields: `compliance_m_n` [2] static compliance 1/K in x and y, m/N, 0 rigid; `frequency_hz` [2] natural
    frequency, Hz; `damping` [2] damping ratio. Bound by `recall`: `moved_m` [M, N, 2] displacement less that
    when the tooth m before passed, m; `known` [M, N] 1 where the memory reaches back that far; `now_m`,
    `rate_m_s` [2] displacement and its rate.
    """

    name = "regenerative_chatter"
    stage = "structure"
    strength = "compliance_m_n"
    parameters = {
        "compliance_m_n": Parameter(
            "m/N", 0.0, 1e-3, 0.0, 1e-7, length=2, source="robots 1e-6, machines 1e-8"
        ),
        "frequency_hz": Parameter("Hz", 5.0, 5000.0, None, 300.0, log=True, length=2),
        "damping": Parameter("1", 0.001, 0.3, None, 0.02, log=True, length=2, source="0.5-5 %"),
    }
    steady = False
    coupled = True
    signature = "lines at f_c + k f_t with f_c off the spindle's multiples, above a threshold of depth"
    confused_with = {"robot_mode": "a forced resonance keeps to multiples of the spindle; shift it by 3 %"}

    compliance_m_n: ArrayLike
    frequency_hz: ArrayLike
    damping: ArrayLike
    moved_m: ArrayLike | None = None
    known: ArrayLike | None = None
    now_m: ArrayLike | None = None
    rate_m_s: ArrayLike | None = None

    def init(self, model: ForceModel) -> Any:
        return jnp.zeros((2, 2)), jnp.zeros((HISTORY, 2))

    def recall(self, state: Any, cut: Cut, dt_s: ArrayLike, model: ForceModel) -> RegenerativeChatter:
        response, past = state
        compliance = jnp.asarray(self.compliance_m_n)
        now = compliance * (response[0] + 0.5 * dt_s * response[1])
        line = jnp.concatenate([now[None], past])
        speed = jnp.maximum(jnp.asarray(cut.spindle_speed_rev_s), 1e-9)
        cutter = model.cutter()
        apart = earlier_passes(cutter, _passes(cutter))[1]
        steps = apart.T / (2.0 * jnp.pi * speed * dt_s)
        lower = jnp.clip(jnp.floor(steps), 0, HISTORY - 1).astype(int)
        share = (steps - lower)[..., None]
        then = line[lower] * (1.0 - share) + line[lower + 1] * share
        known = steps <= HISTORY
        then = jnp.where(known[..., None], then, now)
        then = then.at[0].set(jnp.where(known[0][:, None], then[0], jnp.nan))
        bound = (now - then, known.astype(now.dtype), now, compliance * response[1])
        return RegenerativeChatter(self.compliance_m_n, self.frequency_hz, self.damping, *bound)

    def spindle(self, cut: Cut, model: ForceModel) -> Cut:
        if self.rate_m_s is None:
            return cut
        rate = jnp.asarray(self.rate_m_s)
        return cut.replace(
            vibration_x_m_s=cut.vibration_x_m_s + rate[0], vibration_y_m_s=cut.vibration_y_m_s + rate[1]
        )

    def chip(self, chip: Chip, cut: Cut, model: ForceModel) -> Chip:
        if self.moved_m is None:
            return chip
        moved, cutter = jnp.asarray(self.moved_m), model.cutter()
        feed_m = jnp.asarray(cut.feed_per_revolution_m())[..., None, None]
        sine, cosine = jnp.sin(chip.angle_rad), jnp.cos(chip.angle_rad)
        left = left_standing(cutter, feed_m, chip.angle_rad, cutter.radius_m, _passes(cutter))
        wave = moved[..., 0].T * sine[..., None] + moved[..., 1].T * cosine[..., None]
        beyond = _NO_SURFACE_M * (1.0 - jnp.asarray(self.known).T).at[:, 0].set(0.0)
        # what the chip was before, by the effects ahead, less what the rigid tool would have left of it
        without = jnp.maximum(carried_over(cutter, feed_m, chip.angle_rad, cutter.radius_m), 0.0)
        bare = chip.thickness_m + least(left + wave + beyond) - without
        return chip._replace(
            thickness_m=jnp.maximum(bare, 0.0),
            contact=chip.contact * touching(bare, feed_m / model.tool.teeth),
        )

    def respond(
        self, state: Any, force: Array, cut: Cut, dt_s: ArrayLike, model: ForceModel
    ) -> tuple[Any, Array]:
        response, past = state
        response, _ = second_order_step(
            response, force[:2], dt_s, jnp.asarray(self.frequency_hz), jnp.asarray(self.damping)
        )
        now = jnp.zeros(2) if self.now_m is None else jnp.asarray(self.now_m)
        return (response, jnp.concatenate([now[None], past[:-1]])), force


def _passes(cutter: Cutter) -> int:
    """How many passes are looked back at."""
    return max(int(cutter.lag_rad.shape[0]), PASSES)
