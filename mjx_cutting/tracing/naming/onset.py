"""A tooth that breaks in the middle of a session: nothing before, the same in every cut after.

When it broke is no unknown to descend in. The lines that tell the teeth apart show it by themselves: against
those of tooth passing they are small in every cut before, and far larger in every one after. Where trials in
the order of the length cut part so, the search looks for a tooth that breaks between them; else for one that
was broken all along.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from jax import Array
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect, Tool
from mjx_cutting.cutting.effects.broken_tooth import BrokenTooth
from mjx_cutting.tracing.fitting.problem import Problem

_HARMONICS = 2
_FEWEST = 2
_TIMES_MORE = 3.0


class BreaksWithin(BrokenTooth):
    """A tooth that breaks after a length cut that is `held`."""

    onset: ClassVar[float]

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> BrokenTooth:
        whole = BrokenTooth.build(coordinates, tool)
        return cls(whole.share, whole.tooth, cls.onset)


def with_onset(problem: Problem, kinds: Sequence[type[AbstractEffect]]) -> list[type[AbstractEffect]]:
    """The kinds, a broken tooth among them as one that breaks where the trials show it."""
    if BrokenTooth not in kinds or problem.tool.teeth == 1:
        return list(kinds)
    between = broken_between(
        teeth_apart(problem),
        np.asarray(problem.cut.cut_length_m) - 0.5 * np.asarray(problem.path_m),
        np.asarray(problem.cut.cut_length_m) + 0.5 * np.asarray(problem.path_m),
    )
    if between is None:
        return list(kinds)
    own = {"onset": float(np.mean(between)), "held": {"onset_m": between}}
    breaks = type("BreaksWithin", (BreaksWithin,), own)
    return [breaks if kind is BrokenTooth else kind for kind in kinds]


def broken_between(
    apart: NDArray[np.floating], start_m: NDArray[np.floating], end_m: NDArray[np.floating]
) -> tuple[float, float] | None:
    """Length cut, m, at the end of the last trial whose teeth are alike, and at the start of the first where
    they are not; None where the trials do not part so.

    Arguments: [R] how much the teeth differ in each trial; [R] length cut at its start, and at its end.
    """
    order = np.argsort(start_m)
    value, last = apart[order], len(order) - _FEWEST
    for first in range(_FEWEST, last + 1):
        # lengths that are not given start all at one
        parted = start_m[order[first]] > start_m[order[first - 1]]
        if parted and value[first:].min() > _TIMES_MORE * value[:first].max():
            begins = float(start_m[order[first]])
            return min(float(end_m[order[first - 1]]), begins), begins
    return None


def teeth_apart(problem: Problem) -> NDArray[np.floating]:
    """[R] size of the lines between those of tooth passing, over the size of those, as measured; of the
    lowest only, which none that is folded at half the sampling rate lies upon."""
    order = problem.order[problem.order <= _HARMONICS * problem.tool.teeth]
    low, passing, turns = slice(0, len(order)), order % problem.tool.teeth == 0, order > 0
    sizes = []
    for factor, whitened in zip(np.asarray(problem.factor), np.asarray(problem.whitened), strict=True):
        gram, product = (factor @ factor.T)[low, low], (factor @ whitened)[low]
        line = np.linalg.solve(gram, product) * np.asarray(problem.weight)
        sizes.append([np.linalg.norm(line[each & turns]) for each in (~passing, passing)])
    between, at = np.transpose(sizes)
    return np.asarray(between / np.maximum(at, 1e-300))
