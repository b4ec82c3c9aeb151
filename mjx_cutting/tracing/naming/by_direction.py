"""A size effect whose exponent is another for every direction of the force.

One exponent for all is tried first, because fewer unknowns leave more to be sure of. Kienzle's tables have
one for the cutting force, one for the feed force and one for the passive force; where they differ, ploughing,
which has a ratio for each direction, comes closer than one exponent does. So each direction that the trials
show is given its own, where they explain more than chance does.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array

from mjx_cutting.cutting import Tool
from mjx_cutting.cutting.effects.size_effect import SizeEffect
from mjx_cutting.tracing.naming.candidate import Candidate
from mjx_cutting.tracing.naming.place import Place

_SHOWN_BY = {"radial": 0, "axial": 2}
_RATIOS = (1.0, 2.0)


class SizeEffectByDirection(SizeEffect):
    """A size effect with an exponent of their own for the directions `apart`. Coordinates: that of
    `SizeEffect`, then for each of them the logarithm of its ratio."""

    apart: ClassVar[tuple[str, ...]]

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 1 + len(cls.apart)

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> SizeEffectByDirection:
        alike = SizeEffect.build(coordinates[:1], tool)
        ratios = {f"{each}_ratio": jnp.exp(own) for each, own in zip(cls.apart, coordinates[1:], strict=True)}
        return cls(alike.exponent, **ratios)

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.pad(SizeEffect.starts(tool), ((0, 0), (0, len(cls.apart))))


def by_direction(found: Candidate, place: Place) -> Candidate:
    """The candidate `found`, or a size effect by direction where that has one exponent and explains less."""
    if found.kind is not SizeEffect or not place.worth_it(found):
        return found
    alive = place.contest.problem.alive
    apart = tuple(each for each, axis in _SHOWN_BY.items() if alive[axis])
    if not apart:
        return found
    kind = type("SizeEffectByDirection", (SizeEffectByDirection,), {"apart": apart})
    ratios = np.stack(np.meshgrid(*[np.log(_RATIOS)] * len(apart)), axis=-1).reshape(-1, len(apart))
    return place.better(found, kind, [np.append(found.fit.x, each) for each in ratios])
