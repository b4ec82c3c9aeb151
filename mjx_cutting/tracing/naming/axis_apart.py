"""A resonance of the transducer that is not the same on every axis.

A transducer is often stiffer, or softer, along the tool's axis, and seldom quite alike along the feed and
across it. One frequency for all axes is tried first, because fewer unknowns leave more to be sure of. It then
makes the force along an axis worse where that has another, and would be refused for it. So z is given a
frequency and a damping of its own, then y, and each keeps them where they explain more than chance does.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array

from mjx_cutting.cutting import Tool
from mjx_cutting.cutting.effects.sensor_resonance import SensorResonance
from mjx_cutting.tracing.naming.candidate import Candidate
from mjx_cutting.tracing.naming.place import Place

_AXES = {"axial": 2, "lateral": 1}
_RATIOS = (0.4, 0.6, 0.8, 0.95, 1.05, 1.25, 1.5, 1.8, 2.5)


class ResonanceByAxis(SensorResonance):
    """A resonance with frequency and damping of their own along the axes `apart`. Coordinates: those of
    `SensorResonance`, then for each such axis the logarithms of the two ratios."""

    apart: ClassVar[tuple[str, ...]]

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 2 + 2 * len(cls.apart)

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> ResonanceByAxis:
        alike = SensorResonance.build(coordinates[:2], tool)
        ratios = {}
        for place, along in enumerate(cls.apart, start=1):
            ratios[f"{along}_frequency_ratio"] = jnp.exp(coordinates[2 * place])
            ratios[f"{along}_damping_ratio"] = jnp.exp(coordinates[2 * place + 1])
        return cls(alike.frequency_hz, alike.damping, **ratios)

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.pad(SensorResonance.starts(tool), ((0, 0), (0, 2 * len(cls.apart))))

    @classmethod
    def again(cls, coordinates: np.ndarray, tool: Tool) -> np.ndarray:
        return np.zeros((0, cls.size(tool)))


def axis_apart(found: Candidate, place: Place) -> Candidate:
    """The candidate `found`, or a resonance by axis where that is one of all axes and some show another."""
    if found.kind is not SensorResonance or not place.worth_it(found):
        return found
    apart: tuple[str, ...] = ()
    for along, axis in _AXES.items():
        if not place.contest.problem.alive[axis]:
            continue
        kind = type("ResonanceByAxis", (ResonanceByAxis,), {"apart": (*apart, along)})
        better = place.better(found, kind, _starts(np.asarray(found.fit.x), len(apart)))
        if better is not found:
            found, apart = better, (*apart, along)
    return found


def _starts(x: np.ndarray, apart: int) -> list[np.ndarray]:
    """Unknowns [U + 2] with one axis more apart than the `apart` that are: the frequency found may be that of
    the others, or its own."""
    first = len(x) - 2 - 2 * apart
    starts = []
    for step in np.log(_RATIOS):
        own = np.append(x, [0.0, 0.0])
        own[first] -= step
        own[first + 2 : -2 : 2] += step
        for start in (np.append(x, [0.0, 0.0]), own):
            start[-2] = step
            starts.append(start)
    return starts
