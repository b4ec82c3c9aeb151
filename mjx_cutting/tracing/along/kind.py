"""How an effect that changes along a trial is looked for: its shapes, its columns, what they make."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect, effect_class
from mjx_cutting.tracing.along.shapes import Sums, sums
from mjx_cutting.tracing.records.course import Course

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Kind:
    """How one slow effect is looked for.

    Fields:
        name: the effect in the library.
        testable: whether these trials can show it.
        grid: shapes [P, d] worth trying on these trials.
        columns: [T, 3, k] what one shape adds for each unit coefficient.
        sums: the sufficient statistics of many shapes, where there is a faster way than by `columns`.
        build: the effect from a shape [d] and coefficients [k].
        parts: the shape [d] and the coefficients [k] that `build` makes an effect from; None where its force
            is predicted otherwise, from lines that move along the path.
        own_phase: whether the effect starts each trial at a phase of its own, as a line that nothing ties to
            the trial does; its coefficients are then cosines [k / 2] and sines [k / 2].
        rather: why an effect found is more likely something else, in words; "" where it is not.
        several: whether there may be more than one of it: a layer beside another, a harmonic of the mains.
        stack: of what may be together what none is alone, as the layers of a sheet: the sufficient statistics
            of several shapes [n, d] at once, as a function of them.
        shared: whether a shape may lie where few trials reach, so that only what several show is looked at.
        untold: parameters that stay at the value of no effect, or the usual one, where the trials say nothing
            of them.
        refine: shapes [P, d] around one [d] of those tried, closer than the first grid by a factor and more.
    """

    name: str
    testable: Callable[[Sequence[Course]], bool]
    grid: Callable[[Sequence[Course]], Array]
    columns: Callable[[Course, Array], Array]
    build: Callable[[Array, Array], AbstractEffect]
    parts: Callable[[AbstractEffect], tuple[Array, Array]] | None = None
    own_phase: bool = False
    several: bool = False
    shared: bool = False
    untold: tuple[str, ...] = ()
    rather: Callable[[Sequence[Course], AbstractEffect], str] | None = None
    refine: Callable[[Array, Array, float], Array] | None = None
    sums: Callable[[Sequence[Course], Array], Sums] | None = None
    stack: Callable[[Sequence[Course]], Callable[[Array], Sums]] | None = None

    def sums_of(self, courses: Sequence[Course], shapes: Array) -> Sums:
        """Sufficient statistics over the shapes [P, d] of every trial."""
        return sums(self.columns, courses, shapes) if self.sums is None else self.sums(courses, shapes)

    @property
    def effect(self) -> type[AbstractEffect]:
        """The effect's class."""
        return effect_class(self.name)


def as_values(effect: AbstractEffect) -> dict[str, Any]:
    """Parameter values of an effect as arrays, by name."""
    return {name: np.asarray(value, dtype=float) for name, value in effect.values().items()}


def listed(effect: AbstractEffect, *names: str) -> Array:
    """[n] values of an effect's scalar parameters, in the order of the `names`."""
    values = as_values(effect)
    return np.array([float(values[name]) for name in names])
