"""A resonance of the transducer that is another along the tool's axis than across it.

A transducer is often stiffer, or softer, along the tool's axis. One frequency for all axes is tried first,
because fewer unknowns leave more to be sure of. It then makes the force along the axis worse where that has
another, and would be refused for it. So z is given a frequency and a damping of its own, and keeps them where
that explains more than chance does.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import Array

from mjx_cutting.cutting import Tool
from mjx_cutting.cutting.effects.sensor_resonance import SensorResonance
from mjx_cutting.tracing.naming.candidate import Candidate
from mjx_cutting.tracing.naming.place import Place

_RATIOS = (0.4, 0.6, 0.8, 0.95, 1.05, 1.25, 1.5, 1.8, 2.5)


class ResonanceByAxis(SensorResonance):
    """A resonance with frequency and damping of its own along z. Coordinates: those of `SensorResonance`,
    then the logarithms of the two ratios."""

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 4

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> ResonanceByAxis:
        alike = SensorResonance.build(coordinates[:2], tool)
        return cls(alike.frequency_hz, alike.damping, jnp.exp(coordinates[2]), jnp.exp(coordinates[3]))

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.pad(SensorResonance.starts(tool), ((0, 0), (0, 2)))

    @classmethod
    def again(cls, coordinates: np.ndarray, tool: Tool) -> np.ndarray:
        return np.zeros((0, cls.size(tool)))


def axis_apart(found: Candidate, place: Place) -> Candidate:
    """The candidate `found`, or a resonance by axis where that is one of all axes and z shows another."""
    shows_z = place.contest.problem.alive[2]
    if found.kind is not SensorResonance or not shows_z or not place.worth_it(found):
        return found
    x = np.asarray(found.fit.x)
    starts = [np.append(x, [np.log(ratio), 0.0]) for ratio in _RATIOS]
    return place.better(found, ResonanceByAxis, starts)
