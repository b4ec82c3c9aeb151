"""Where no named effect explains what goes with a condition, or with the arc: an unnamed factor is fitted.

It is the last thing tried, over what the residual was found to depend on, conditions of the trials or the
angle of the edge, and it must lower the error on held-out trials clearly. The verdict stays what it is: a
factor is no cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect, ForceModel, Tool
from mjx_cutting.cutting.effects.unnamed_arc import HARMONICS, UnnamedArc, along_arc
from mjx_cutting.cutting.effects.unnamed_gain import CONDITIONS, KNOTS, UnnamedGain, conditions
from mjx_cutting.tracing.fitting.heldout import HeldOut, held_out
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.naming.candidate import fitted
from mjx_cutting.tracing.naming.chance import STANDARD_ERRORS, gain_over_trials
from mjx_cutting.tracing.naming.search import Search
from mjx_cutting.tracing.records.lines import Lines
from mjx_cutting.tracing.telling.dependence import Dependence

_TOGETHER = "feed with spindle speed"
_ARC = "tooth phase"
_TOLD_AT = 5
_MOST_CONDITIONS = 3
_LEAST_GAIN = 0.1
_FEWEST_TRIALS_A_VALUE = 2


@dataclass(frozen=True, eq=False)
class Unnamed:
    """A `model` with unnamed factors, what they go with, error on held-out trials without them and with them;
    `along` the arc, in words, where one goes with that."""

    model: ForceModel
    over: tuple[str, ...]
    before: HeldOut
    after: HeldOut
    along: str = ""

    def __str__(self) -> str:
        return (
            f"an unnamed factor on the force over {' and '.join(self.over)} was fitted and added to the "
            f"model: it brings the error on held-out trials from {self.before.nrmse:.2%} to "
            f"{self.after.nrmse:.2%}, names no cause, and holds within the range of these trials only"
            f"{self.along}"
        )


def unnamed_factor(search: Search, lines: Lines, left: Sequence[Dependence]) -> Unnamed | None:
    """The factors over what the residual depends on; None where there is none or it does little (call it in
    float64).

    Arguments: the outcome of the search over steady effects; the lines it was made on; the tests of what its
        model leaves, the strongest first.
    """
    problem, fold = search.problem, search.final.fold
    told = [each.covariate for each in left if each.found]
    tried: list[tuple[tuple[str, ...], type[AbstractEffect]]] = []
    if _ARC in told and _arc_is_told(problem, lines):
        tried.append(((_ARC,), UnnamedArc))
    if over := _conditions(told, problem.trials):
        tried.append((over, _over(problem, over)))
    if not tried:
        return None
    x = np.asarray(search.final_fit.x)
    plain = held_out(problem, lines, search.effects, x, fold)
    model, error, kept = search.final_fit.model, search.final, search.effects
    names: tuple[str, ...] = ()
    for more, kind in tried:
        start = np.concatenate([x, np.zeros(kind.size(problem.tool))])
        fit, factored = fitted(problem, lines, (*kept, kind), start, fold)
        left_n2 = search.final.error_n2 + factored.error_n2 - plain.error_n2
        after = replace(search.final, error_n2=np.maximum(left_n2, 0.0))
        gain, uncertain = gain_over_trials(error, after)
        if gain > max(STANDARD_ERRORS * uncertain, _LEAST_GAIN * error.nrmse):
            model, error, kept, x = fit.model, after, (*kept, kind), np.asarray(fit.x)
            names += more
    if not names:
        return None
    return Unnamed(model, names, search.final, error, _along(problem, model))


def _conditions(told: Sequence[str], trials: int) -> tuple[str, ...]:
    """Those of the covariates `told` that are conditions, as many as so many trials tell."""
    over = [each for each in told if each in CONDITIONS]
    if _TOGETHER in over:
        # how two conditions act together is told beside what each does alone
        over = list(dict.fromkeys([*CONDITIONS[:2], *over]))
    return tuple(over[: min(_MOST_CONDITIONS, trials // ((KNOTS - 1) * _FEWEST_TRIALS_A_VALUE))])


def _arc_is_told(problem: Problem, lines: Lines) -> bool:
    """Whether every trial shows as many of the first multiples of tooth passing as the factor along the arc
    has harmonics: fewer are met by many a factor, and each says something else of the arc."""
    teeth = problem.tool.teeth
    passing = lines.present[:, 1::2][:, teeth - 1 :: teeth][:, :HARMONICS]
    return passing.shape[1] == HARMONICS and bool(np.all(passing > 0.0))


def _along(problem: Problem, model: ForceModel) -> str:
    """In words, how the factor of the tangential force goes along the arc that the trials cut, if it does."""
    gain = next((each.gain for each in model.effects if isinstance(each, UnnamedArc)), None)
    if gain is None:
        return ""
    begin = float(np.min(problem.cut.entry_rad))
    end = float(np.max(problem.cut.exit_rad))
    angles = np.linspace(begin, end, _TOLD_AT)
    factor = np.asarray(along_arc(gain, angles))[:, 0]
    told = ", ".join(
        f"{each - 1.0:+.0%} at {np.rad2deg(angle):.0f}"
        for each, angle in zip(factor / np.mean(factor), angles, strict=True)
    )
    return (
        f"; along the arc the tangential force is off its mean by {told} degrees from the normal to the "
        "feed, as a sheet would have it whose strength goes with the direction of cutting"
    )


class _Over(UnnamedGain):
    """The factor over some conditions, its knots in their places: what remains to be fitted."""

    over: ClassVar[tuple[int, ...]]
    placed: ClassVar[tuple[float, ...]]

    @classmethod
    def size(cls, tool: Tool) -> int:
        return (KNOTS - 1) * len(cls.over)

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> UnnamedGain:
        typical = cls.parameters["gain"].typical
        gain = jnp.zeros((len(CONDITIONS), KNOTS - 1)).at[jnp.asarray(cls.over)]
        value = gain.set(typical * coordinates.reshape(-1, KNOTS - 1))
        return UnnamedGain(value.ravel(), jnp.asarray(cls.placed))


def _over(problem: Problem, over: Sequence[str]) -> type[_Over]:
    """The factor over the conditions named, with knots at the lowest, the middle and the highest of each."""
    measured = np.asarray(conditions(problem.cut))
    places = np.zeros((len(CONDITIONS), KNOTS))
    chosen = tuple(CONDITIONS.index(name) for name in over)
    for index in chosen:
        places[index] = _spread(measured[:, index])
    return type("UnnamedGainOver", (_Over,), {"over": chosen, "placed": tuple(places.ravel().tolist())})


def _spread(values: NDArray[np.floating]) -> NDArray[np.floating]:
    return np.quantile(np.unique(values), np.linspace(0.0, 1.0, KNOTS))
