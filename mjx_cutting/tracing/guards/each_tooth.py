"""A value of its own for each tooth, of unknown cause, of which the mean says nothing."""

from __future__ import annotations

from typing import ClassVar, Self

from jax import Array

from mjx_cutting.cutting import AbstractEffect, Tool
from mjx_cutting.cutting.effects.coordinates import with_no_sum


class EachTooth(AbstractEffect):
    """An effect with its strength [N] for each tooth as its one parameter; no cause, and never named."""

    physical: ClassVar[bool] = False

    @classmethod
    def size(cls, tool: Tool) -> int:
        return tool.teeth - 1

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> Self:
        """Coordinates: values of all teeth but the last, in units of a typical one; their sum is nil."""
        return cls(with_no_sum(cls.parameters[cls.strength].typical * coordinates))
