"""What an effect brought to a model, which every guard is asked about."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import Effects, Fit
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.records.lines import Lines

_STEPS = 20


@dataclass(frozen=True, eq=False)
class Gain:
    """What the last of `effects` brought.

    Fields:
        problem, lines: the trials.
        effects: of the model, the one that is asked about last.
        before, found: fits of the model to all trials, without the last and with it.
    """

    problem: Problem
    lines: Lines
    effects: Effects
    before: Fit
    found: Fit

    @property
    def kind(self) -> type[AbstractEffect]:
        """The effect asked about."""
        return self.effects[-1]

    @property
    def others(self) -> Effects:
        """The effects before it."""
        return self.effects[:-1]

    @property
    def rest(self) -> NDArray[np.floating]:
        """[U'] unknowns of the model with it, less its own."""
        known = np.asarray(self.found.x)
        return known[: len(known) - self.kind.size(self.problem.tool)]

    def squares_with(self, instead: type[AbstractEffect]) -> float:
        """What is left over all trials, squared, weighted, with another effect, from none of it, in place of
        the one asked about."""
        descent = Descent(self.problem, (*self.others, instead))
        start = np.append(self.rest, np.zeros(instead.size(self.problem.tool)))
        return float(descent.squares_left(descent.descend(start, _STEPS)[0][None])[0])
