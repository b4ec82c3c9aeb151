"""Ploughing whose borderline is gradual.

A sharp borderline, below which all is ploughed and above which nothing is, is tried first. No edge is quite
like that, and where it is not, the size effect, which bends everywhere, comes closer than a sharp borderline
does. So the gradual one takes its place where it explains more than chance does.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import Array

from mjx_cutting.cutting import Tool
from mjx_cutting.cutting.effects.ploughing import Ploughing
from mjx_cutting.tracing.naming.candidate import Candidate
from mjx_cutting.tracing.naming.place import Place

_THICKER = (0.5, 1.0, 2.0)


class GradualPloughing(Ploughing):
    """Ploughing with a gradual borderline. Coordinates: those of `Ploughing`."""

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> GradualPloughing:
        sharp = Ploughing.build(coordinates, tool)
        return cls(sharp.minimum_chip_m, sharp.ratio, jnp.ones(()))


def gradually(found: Candidate, place: Place) -> Candidate:
    """The candidate `found`, or gradual ploughing where that is a sharp one and explains less."""
    if found.kind is not Ploughing or not place.worth_it(found):
        return found
    size = Ploughing.size(place.contest.problem.tool)
    starts = []
    for thicker in _THICKER:
        x = np.array(found.fit.x)
        x[-size] *= thicker
        starts.append(x)
    return place.better(found, GradualPloughing, starts)
