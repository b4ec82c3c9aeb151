"""Where no named effect explains what goes with a condition of the trials: an unnamed factor is fitted.

It is the last thing tried, over the conditions that the residual was found to depend on, and it must lower
the error on held-out trials clearly. The verdict stays what it is: a factor is no cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from mjx_cutting.cutting import ForceModel, Tool
from mjx_cutting.cutting.effects.unnamed_gain import CONDITIONS, KNOTS, UnnamedGain, conditions
from mjx_cutting.tracing.fitting.heldout import HeldOut, held_out
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.naming.candidate import fitted
from mjx_cutting.tracing.naming.chance import STANDARD_ERRORS, gain_over_trials
from mjx_cutting.tracing.naming.search import Search
from mjx_cutting.tracing.records.lines import Lines
from mjx_cutting.tracing.telling.dependence import Dependence

_TOGETHER = "feed with spindle speed"
_MOST_CONDITIONS = 3
_LEAST_GAIN = 0.1
_FEWEST_TRIALS_A_VALUE = 2


@dataclass(frozen=True, eq=False)
class Unnamed:
    """A `model` with an unnamed factor, the conditions it goes with, error on held-out trials without it
    and with it."""

    model: ForceModel
    over: tuple[str, ...]
    before: HeldOut
    after: HeldOut

    def __str__(self) -> str:
        return (
            f"an unnamed factor on the force over {' and '.join(self.over)} was fitted and added to the "
            f"model: it brings the error on held-out trials from {self.before.nrmse:.2%} to "
            f"{self.after.nrmse:.2%}, names no cause, and holds within the range of these trials only"
        )


def unnamed_gain(search: Search, lines: Lines, left: Sequence[Dependence]) -> Unnamed | None:
    """The factor over the conditions that what is left depends on; None where there is none or it does little
    (call it in float64).

    Arguments: the outcome of the search over steady effects; the lines it was made on; the tests of what its
        model leaves, the strongest first.
    """
    problem, fold = search.problem, search.final.fold
    told = [each.covariate for each in left if each.found and each.covariate in CONDITIONS]
    if _TOGETHER in told:
        # how two conditions act together is told beside what each does alone
        told = list(dict.fromkeys([*CONDITIONS[:2], *told]))
    over = tuple(told[: min(_MOST_CONDITIONS, problem.trials // ((KNOTS - 1) * _FEWEST_TRIALS_A_VALUE))])
    if not over:
        return None
    kind = _over(problem, over)
    x = np.asarray(search.final_fit.x)
    plain = held_out(problem, lines, search.effects, x, fold)
    start = np.concatenate([x, np.zeros(kind.size(problem.tool))])
    found, factored = fitted(problem, lines, (*search.effects, kind), start, fold)
    error = search.final.error_n2 + factored.error_n2 - plain.error_n2
    after = replace(search.final, error_n2=np.maximum(error, 0.0))
    gain, uncertain = gain_over_trials(search.final, after)
    if not gain > max(STANDARD_ERRORS * uncertain, _LEAST_GAIN * search.final.nrmse):
        return None
    return Unnamed(found.model, over, search.final, after)


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
