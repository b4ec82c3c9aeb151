"""A resonance of the transducer that is not the same on every axis.

A transducer is often stiffer, or softer, along the tool's axis, and seldom quite alike along the feed and
across it. One frequency for all axes is tried first, because fewer unknowns leave more to be sure of. It then
makes the force along an axis worse where that has another, and would be refused for it. So z is taken for
stiff, without any, then given a frequency and a damping of its own, then y: the first where that leaves less,
the second where it explains more than chance does.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting import Tool
from mjx_cutting.cutting.effects.sensor_resonance import STIFF, SensorResonance
from mjx_cutting.tracing.naming.candidate import Candidate
from mjx_cutting.tracing.naming.place import Place

_AXES = {"axial": 2, "lateral": 1}
_RATIOS = (0.4, 0.6, 0.8, 0.95, 1.05, 1.25, 1.5, 1.8, 2.5)


class ResonanceByAxis(SensorResonance):
    """A resonance with frequency and damping of their own along the axes `apart`, and none along those that
    are `stiff`. Coordinates: those of `SensorResonance`, then for each axis apart the logarithms of the two
    ratios."""

    apart: ClassVar[tuple[str, ...]]
    stiff: ClassVar[tuple[str, ...]]

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 2 + 2 * len(cls.apart)

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> ResonanceByAxis:
        alike = SensorResonance.build(coordinates[:2], tool)
        ratios: dict[str, ArrayLike] = {f"{along}_frequency_ratio": STIFF for along in cls.stiff}
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
    stiff: tuple[str, ...] = ()
    for along, axis in _AXES.items():
        if place.contest.problem.alive[axis]:
            without = place.instead(found, _by_axis(apart, (*stiff, along)), np.asarray(found.fit.x))
            better = _with_its_own(without, place, (*apart, along), stiff)
            if better is not without:
                apart = (*apart, along)
            elif without is not found:
                stiff = (*stiff, along)
            found = better
    for along in stiff:
        # what the others are is known better now
        rest = tuple(each for each in stiff if each != along)
        better = _with_its_own(found, place, (*apart, along), rest)
        if better is not found:
            found, apart, stiff = better, (*apart, along), rest
    return found


def _with_its_own(
    found: Candidate, place: Place, apart: tuple[str, ...], stiff: tuple[str, ...]
) -> Candidate:
    """The candidate `found`, or one with a resonance of its own along the last of the axes `apart`, where
    that explains more than chance does."""
    starts = _starts(np.asarray(found.fit.x), len(apart) - 1)
    return place.better(found, _by_axis(apart, stiff), starts)


def _by_axis(apart: tuple[str, ...], stiff: tuple[str, ...]) -> type[ResonanceByAxis]:
    return type("ResonanceByAxis", (ResonanceByAxis,), {"apart": apart, "stiff": stiff})


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
