"""Entry and exit: at the ends of the sheet a tooth finds material over a part of its arc only.

The sheet spans start <= position <= start + length as met by the rim of the tool. When the rim has gone in by
s, the axis stands at s - sqrt(2 R a - a^2) (s - R for a depth beyond the radius) from the end, and a tooth at
angle th is in the sheet only where that plus R sin th lies inside. So the engagement grows over the first
sqrt(2 R a - a^2), not at once, and fades over as much after the far end. Positions counted from the first
touch are the rim's; those of a machine are the axis', and rims of other depths touch at other ones. Exact for
circular paths; burrs and break-out are not modelled. Signature: local to the ends, repeatable, known from
geometry. Confused with a mode that rings at entry, which decays afterwards.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.chip import Chip
from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.registry import register
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

_FEATHER_RAD = 1e-3
_FOREMOST = 1.0 - 1e-7  # where arcsin still has a slope


@register
class EntryExit(AbstractEffect):
    """Engagement at the ends of the sheet.

    Fields: `share` [] how much of the geometry is applied, 0 none to 1 all; `start_m` [] position at which
    the rim meets the sheet, m; `length_m` [] length of the sheet, m; `by_axis` [] 0 where positions are those
    of the rim, 1 where they are those of the tool's axis.
    """

    name = "entry_exit"
    stage = "chip"
    strength = "share"
    parameters = {
        "share": Parameter("1", 0.0, 1.2, 0.0, 1.0, source="geometry: 1; more where what rubs ends too"),
        "start_m": Parameter("m", -1.0, 10.0, None, 0.0),
        "length_m": Parameter("m", 1e-3, 1e3, None, 0.0),
        "by_axis": Parameter("1", 0.0, 1.0, None, 0.0, source="how positions were taken"),
    }
    steady = False
    alike = True
    signature = "missing force at the ends of the sheet, the same in every trial"
    confused_with = {"clamp_mode": "a mode rings and decays; geometry does not"}

    share: ArrayLike
    start_m: ArrayLike = 0.0
    length_m: ArrayLike = 1e3
    by_axis: ArrayLike = 0.0

    def chip(self, chip: Chip, cut: Cut, model: ForceModel) -> Chip:
        begin, end = (each[..., None, None] for each in self._ends(cut, model))
        ahead = jnp.sin(chip.angle_rad)
        within = jnp.minimum(ahead - begin, end - ahead)
        gate = jnp.maximum(jnp.asarray(cut.gate_rad)[..., None, None], _FEATHER_RAD)
        inside = jnp.clip(0.5 + within / gate, 0.0, 1.0)
        return chip._replace(contact=chip.contact * (1.0 - self.share * (1.0 - inside)))

    def arcs(self, cut: Cut, model: ForceModel) -> list[tuple[Array, Cut]]:
        """All of the arc, and in its stead what has come to the near end less what is beyond the far one."""
        share = jnp.asarray(self.share)
        begin, end = self._ends(cut, model)
        return [(1.0 - share, cut), (share, part_of_arc(cut, begin)), (-share, part_of_arc(cut, end))]

    def _ends(self, cut: Cut, model: ForceModel) -> tuple[Array, Array]:
        """[...] near and far end of the sheet, ahead of the tool's axis, over its radius."""
        radius = 0.5 * jnp.asarray(model.tool.diameter_m)
        depth = jnp.clip(jnp.asarray(cut.radial_depth_m), 1e-9, radius)
        reach = jnp.sqrt(depth * (2.0 * radius - depth))
        axis = jnp.asarray(cut.position_m) - self.start_m - (1.0 - jnp.asarray(self.by_axis)) * reach
        return -axis / radius, (jnp.asarray(self.length_m) - axis) / radius

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 2

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> EntryExit:
        """Coordinates: share, and start in units of 5 mm; the far end of the sheet is left out."""
        return cls(coordinates[0], 5e-3 * coordinates[1])

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.asarray([[0.9, 0.0], [0.9, 1.0]])

    @classmethod
    def identity(cls, tool: Tool) -> EntryExit:
        return cls(0.0)


def part_of_arc(cut: Cut, ahead: ArrayLike) -> Cut:
    """The cut over the part of its arc that is [...] or more ahead of the tool's axis, over the radius: where
    the sine of a tooth's angle is at least that."""
    ahead = jnp.asarray(ahead)
    begin = jnp.where(ahead < 1.0, jnp.arcsin(jnp.clip(ahead, 0.0, _FOREMOST)), 0.5 * jnp.pi)
    entry = jnp.maximum(jnp.asarray(cut.entry_rad), begin)
    exit_ = jnp.maximum(jnp.minimum(jnp.asarray(cut.exit_rad), jnp.pi - begin), entry)
    return cut.replace(entry_rad=entry, exit_rad=exit_)
