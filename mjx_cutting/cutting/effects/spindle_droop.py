"""Spindle droop: the motor slows under load, so each tooth takes more and the lines shift.

f = f_0 - T(f) / k, T the mean torque: its edge part does not depend on f, its chip part goes as 1 / f, which
makes a quadratic for f. f_0 is the speed without load, `Cut.spindle_speed_rev_s`; where the data give the
speed under load, what is left is how it swings (`UnderLoad`). Signature: lines shift with load, the phase
walks from the nominal, the mean rises. Confused with a wrong speed, which is wrong without load too. Its
memory is the angle by which the tool has fallen behind, and how far the speed is off its mean.

A motor with little inertia follows the torque within the turn as well, as far as its bandwidth f_b lets it:
the speed is off its mean by -(T(t) - T) / k, low-passed to first order at f_b. Over a turn that is periodic,
so tooth passing is drawn out where teeth cut and shortened where they do not, and teeth that differ take
chips by the time since the tooth before. Both are in the lines (`swung`); a record has the first only.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.average import mean_load
from mjx_cutting.cutting.chip import Chip
from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.swing import Ahead, ahead, chip_by_time
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel


@register
class SpindleDroop(AbstractEffect):
    """A motor of finite stiffness.

    Fields: `droop_rev_s_nm` [] 1 / k, loss of speed per torque, rev/s per N m; 0 is rigid. `bandwidth_hz` []
    f_b, Hz; 0 is a motor that follows the mean torque alone. Bound by `recall`: `behind_rad` [] angle that
    the tool has fallen behind, rad. Bound by `swung`: `turn`, how far the tool is ahead within the turn.
    """

    name = "spindle_droop"
    stage = "spindle"
    strength = "droop_rev_s_nm"
    parameters = {
        "droop_rev_s_nm": Parameter("rev/s/(N m)", 0.0, 100.0, 0.0, 1.0, source="1-10 % of the speed"),
        "bandwidth_hz": Parameter("Hz", 0.0, 1e6, None, 0.0, source="0: the mean torque alone"),
    }
    coupled = True
    per_turn = True
    swings = True
    signature = "lines shift with load, phase walks, mean rises"
    confused_with = {"wrong spindle speed": "a wrong speed is off without load too"}

    droop_rev_s_nm: ArrayLike
    bandwidth_hz: ArrayLike = 0.0
    behind_rad: ArrayLike = 0.0
    turn: Ahead | None = None

    def loaded_speed_rev_s(self, cut: Cut, model: ForceModel) -> Array:
        """[...] speed under load, rev/s; a motor past its pull-out torque stays at half of what is left."""
        return self._loaded(cut, model)[0]

    def _loaded(self, cut: Cut, model: ForceModel) -> tuple[Array, Array]:
        """[...] mean speed under load, rev/s, and mean torque at it, N m."""
        load = mean_load(model, cut)
        free = jnp.asarray(cut.spindle_speed_rev_s)
        speed = self.speed_under(free, load.edge_torque, load.chip_torque * free)
        return speed, load.edge_torque + load.chip_torque * free / speed

    def speed_under(self, free: ArrayLike, edge_torque: ArrayLike, chip_power: ArrayLike) -> Array:
        """[...] speed, rev/s, of a motor that turns at `free` without load, under the torque of the edge,
        N m, and that of the chip times the speed, N m rev/s, which does not depend on it."""
        at_rest = jnp.asarray(free)
        left = jnp.maximum(at_rest - self.droop_rev_s_nm * jnp.asarray(edge_torque), 0.05 * at_rest)
        inner = left**2 - 4.0 * self.droop_rev_s_nm * jnp.asarray(chip_power)
        return 0.5 * (left + jnp.sqrt(jnp.maximum(inner, 1e-6 * left**2 + 1e-12)))

    def spindle(self, cut: Cut, model: ForceModel) -> Cut:
        return self._turned(cut.replace(spindle_speed_rev_s=self.loaded_speed_rev_s(cut, model)))

    def _turned(self, cut: Cut) -> Cut:
        angle = jnp.asarray(cut.angle_rad) - self.behind_rad
        gained = self.ahead(angle)
        if gained is None:
            return cut.replace(angle_rad=angle)
        return cut.replace(angle_rad=angle + gained * (1.0 - jnp.asarray(cut.angle_holds_ripple)))

    def swung(self, torque: Array, cut: Cut, model: ForceModel) -> SpindleDroop:
        if self._follows_the_mean:
            return self
        speed = jnp.asarray(self.spindle(cut, model).spindle_speed_rev_s)
        bandwidth_hz, order = jnp.asarray(self.bandwidth_hz), jnp.maximum(jnp.arange(torque.shape[0]), 1)
        answer = bandwidth_hz / (bandwidth_hz + 1j * order * speed)
        turn = ahead(-jnp.asarray(self.droop_rev_s_nm) / speed * torque, answer)
        return eqx.tree_at(lambda effect: effect.turn, self, turn, is_leaf=lambda leaf: leaf is None)

    def ahead(self, angle_rad: ArrayLike) -> Array | None:
        return None if self.turn is None else self.turn.at(angle_rad)

    def chip(self, chip: Chip, cut: Cut, model: ForceModel) -> Chip:
        # teeth that are alike pass at even times
        if self.turn is None or model.cutter().even:
            return chip
        return chip_by_time(chip, cut, model, self.turn.at)

    def init(self, model: ForceModel) -> Any:
        return jnp.zeros(2)

    def recall(self, state: Any, cut: Cut, dt_s: ArrayLike, model: ForceModel) -> SpindleDroop:
        return SpindleDroop(self.droop_rev_s_nm, self.bandwidth_hz, state[0])

    def respond(
        self, state: Any, force: Array, cut: Cut, dt_s: ArrayLike, model: ForceModel
    ) -> tuple[Any, Array]:
        speed, torque = self._loaded(cut, model)
        swing = state[1]
        if not self._follows_the_mean:
            follows = -jnp.expm1(-2.0 * jnp.pi * jnp.asarray(self.bandwidth_hz) * dt_s)
            swing = swing + follows * (model.torque_z(cut) - torque - swing)
        lost = jnp.asarray(cut.spindle_speed_rev_s) - speed + self.droop_rev_s_nm * swing
        return jnp.stack([state[0] + 2.0 * jnp.pi * lost * dt_s, swing]), force

    @property
    def _follows_the_mean(self) -> bool:
        """Whether that is known before anything is traced: then what swings is not even calculated."""
        return isinstance(self.bandwidth_hz, float) and self.bandwidth_hz == 0.0

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 1

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> SpindleDroop:
        """The droop; a fit of lines alone does not look for the bandwidth."""
        return cls(coordinates[0])

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[0.3], [3.0]])


class UnderLoad(SpindleDroop):
    """Droop where the speed given is that under load already: what is left is how it swings."""

    def _loaded(self, cut: Cut, model: ForceModel) -> tuple[Array, Array]:
        load = mean_load(model, cut)
        return jnp.asarray(cut.spindle_speed_rev_s), load.edge_torque + load.chip_torque

    def spindle(self, cut: Cut, model: ForceModel) -> Cut:
        return self._turned(cut)
