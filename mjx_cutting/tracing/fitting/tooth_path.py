"""Circles or the true path of the teeth, whichever the trials have.

The base model has teeth go on circles. What the true path makes of the force, after refitting, is of the
order of the feed per tooth over the radius: 0.2 to 0.5 of that for end mills, and less than (1 + teeth / 40)
of it for saws (`benchmarks/tooth_path.py`). Where that is more than the model may be off by anyway, an effect
would be named for it. So the share of the true path is fitted beside what was found: geometry has no strength
of its own, so where the trials say one rather than nil, they have the true path. It is asked about with the
cusps that teeth leave on the side of the cut and, for forces calculated in the nominal arc, without.
"""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike, NDArray

from mjx_cutting.cutting import AbstractEffect, Tool
from mjx_cutting.cutting.effects.tooth_path import ToothPath
from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import Effects
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.records.levels import LEVEL_KINDS

_TEETH = 40.0
_STEPS = 8
_CLEARLY = 10.0
_MOST = 1.5


class TrueToothPath(ToothPath):
    """The true path as part of every model: nothing is looked for."""

    meets_cusps: ClassVar[float] = 1.0

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 0

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> ToothPath:
        return ToothPath(jnp.asarray(1.0), jnp.asarray(cls.meets_cusps))

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.zeros((1, 0))


class TruePathInArc(TrueToothPath):
    """The same for edges that act in the nominal arc alone."""

    meets_cusps = 0.0


class _Asked(ToothPath):
    """The share of one of them."""

    of: ClassVar[type[TrueToothPath]] = TrueToothPath

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> ToothPath:
        return ToothPath(jnp.sum(coordinates), jnp.asarray(cls.of.meets_cusps))


class _AskedInArc(_Asked):
    of = TruePathInArc


def on_true_path(problem: Problem) -> bool:
    """Whether the models of the problem have their teeth go on the true path."""
    return any(issubclass(each, TrueToothPath) for each in problem.given)


def on_other_path(problem: Problem, effects: Effects, x: ArrayLike) -> Problem | None:
    """The problem with the teeth on the other path, where the trials have that; None where they have this
    one, or cannot tell.

    Arguments: `effects` of the model found, `x` [U] its unknowns, `problem` weighted by what it leaves.
    """
    if not _shows(problem, effects):
        return None
    others = tuple(each for each in problem.given if not issubclass(each, TrueToothPath))
    circles = dataclasses.replace(problem, given=others)
    asked = {each.of: _squares(circles, (*effects, each), np.asarray(x)) for each in (_Asked, _AskedInArc)}
    path = min(asked, key=lambda each: asked[each])
    given = (*others, path) if np.isfinite(asked[path]) else others
    return None if set(given) == set(problem.given) else dataclasses.replace(circles, given=given)


def _squares(circles: Problem, effects: Effects, x: NDArray[np.floating]) -> float:
    """Squared error on the path of which the last of `effects` is the share; without end where the trials do
    not have that rather than `circles`."""
    both = Descent(circles, effects)
    best, squares = both.descend(np.append(x, 0.5), _STEPS)
    share = float(best[-1])
    slope = both.around(best)[1]
    rest, own = slope[:, :-1], slope[:, -1]
    told = float(np.sum((own - rest @ np.linalg.lstsq(rest, own, rcond=None)[0]) ** 2))
    # by how much the squared error on circles is above that on the true path, from the parabola between
    has_it = (2.0 * share - 1.0) * told > _CLEARLY and share < _MOST
    return squares if has_it else np.inf


def _shows(problem: Problem, effects: Effects) -> bool:
    """Whether the true path could change the force by more than a model of it may be off. Teeth that reach
    differently far meet surfaces left up to a whole turn earlier."""
    if problem.tool.kind in LEVEL_KINDS or problem.motion is not None:
        return False
    speed, feed = (np.asarray(each) for each in (problem.cut.spindle_speed_rev_s, problem.cut.feed_speed_m_s))
    teeth, radius_m = problem.tool.teeth, 0.5 * float(np.asarray(problem.tool.diameter_m))
    share = float(np.max(feed / (speed * teeth))) / radius_m
    uneven = any(each.cutter is not AbstractEffect.cutter for each in effects)
    return share * (teeth if uneven else 1.0 + teeth / _TEETH) > problem.tolerance
