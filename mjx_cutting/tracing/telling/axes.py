"""Are the columns of force what the data set says they are?

A sensor mounted another way round, or the force on the sheet taken for the one on the tool, leaves a base
model that fits badly, whatever effect is then added. So where much is left with all effects found, the base
model is fitted again to the forces read in every other way: axes exchanged, signs turned. One that leaves
less than a third of the error is told, and the trials are traced so: where the data set says what its axes
are, that is kept unless all is explained with the other reading, or nearly all with other signs. A strong
effect hides which reading that is, and then the one is looked at in which an effect leaves clearly less than
any does in the others. The sign along the tool's axis cannot be told from lines, for the axial constants may
have either. Of a turning tool, of which other standards have the axes otherwise, the main cutting force is
found (`levels`), and what was made of the columns is told.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.fitting.fit import base_starts, fit
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.fitting.screening import Screened, screen
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import Lines
from mjx_cutting.trials.dataset import Dataset, columns_to_process, process_to_columns

_BAD = 0.1
_POOR = 0.05
_BETTER = 1.0 / 3.0
_WORTH_A_LOOK = 0.7
_EFFECTS = 4
_TELLS = 0.1
_ABOUT_AS_WELL = 1.3
_CLEARLY_LESS = 0.25
_NEARLY_ALL = 0.1
OrderAndSigns = tuple[tuple[int, ...], tuple[float, ...]]
_AS_IS: OrderAndSigns = ((0, 1, 2), (1.0, 1.0, 1.0))


class Reading(NamedTuple):
    """Another way to read the forces.

    Fields: `axes` the data set's key `axes` that would say so; `error`, `now` relative error that the base
    model leaves with it and with the present one, on all trials.
    """

    axes: tuple[str, str, str]
    error: float
    now: float

    def __str__(self) -> str:
        return (
            f"the base model leaves {self.error:.0%} of the force instead of {self.now:.0%} if the columns "
            f"of force are read as {list(self.axes)}: check how the sensor is mounted, and `axes` in "
            "dataset.json"
        )


def other_columns(dataset: Dataset, said: tuple[str, str, str] | None) -> str | None:
    """That the columns of force were read otherwise than the data set's `axes` had `said`, in words; None
    where not."""
    if said == dataset.axes:
        return None
    turned = "the largest as the main cutting force of a turning tool"
    why = turned if dataset.tool.kind == "turning" else "as which they are explained far better"
    but = "" if said is None else f" and not, as dataset.json says, as {list(said)}"
    return (
        f"the columns of force were read as {list(dataset.axes or ())}{but}, {why}: say so in `axes` in "
        "dataset.json, or check how the sensor is mounted"
    )


def most_left(said: tuple[str, str, str] | None, reading: Reading, explained: bool) -> float:
    """Share of what is missing now that a reading may leave to be taken, `explained` whether all is with it:
    one that did not look far better before, or is not what the data set has `said`, is taken only then, or
    where nearly all is with other signs than said."""
    if explained or (said is None and reading.error <= _BETTER * reading.now):
        return _CLEARLY_LESS
    only_signs = said is not None and [each[-1] for each in reading.axes] == [each[-1] for each in said]
    return _NEARLY_ALL if only_signs else 0.0


def read_as(dataset: Dataset, axes: tuple[str, str, str]) -> Dataset:
    """The data set with the columns of force read as `axes`."""

    def again(force_n: NDArray[np.float64]) -> NDArray[np.float64]:
        return columns_to_process(process_to_columns(force_n, dataset.axes), axes)

    noise = dataset.sensor.noise_std_n
    if noise is not None and len(noise) == 3:
        x, y, z = np.abs(again(np.asarray(noise))).tolist()
        noise = (x, y, z)
    trials = (replace(t, force_n=again(t.force_n)) for t in dataset.trials)
    sensor = replace(dataset.sensor, noise_std_n=noise)
    return replace(dataset, axes=axes, sensor=sensor, trials=tuple(trials))


def better_reading(dataset: Dataset, lines: Lines, problem: Problem, left: float) -> Reading | None:
    """The way to read the forces that fits far better than the present one (call it in float64).

    `left`: relative error of the model found.
    """
    if dataset.tool.kind in LEVEL_KINDS or problem.motion is not None or left < _BAD:
        return None
    now = _fitted(problem, lines, _AS_IS).error
    if now < _BAD:
        return None
    best = min((_fitted(problem, lines, way) for way in _ways()), key=lambda each: each.error)
    if best.error > _BETTER * now:
        return None
    return Reading(_as_axes(dataset, *best.way), best.error, now)


def reading_with_an_effect(
    dataset: Dataset, lines: Lines, problem: Problem, screened: Sequence[Screened], left: float
) -> Reading | None:
    """The way to read the forces in which one effect leaves clearly less than any does in another way, and
    than is `left` now (call it in float64).

    Arguments:
        screened: effects as they were looked at beside the base model on the forces as they are; those that
            explain most of them, or of them read as the base model alone fits best, are tried in every way
            that it fits about as well. One that explains next to nothing in both is in neither.
        left: relative error of the model found.
    """
    if dataset.tool.kind in LEVEL_KINDS or problem.motion is not None or left < _POOR or not screened:
        return None
    kinds = _leading(screened)
    ways = [_fitted(problem, lines, way) for way in _ways()]
    fits_best = min(ways, key=lambda each: each.error)
    lowest = fits_best.error
    if fits_best.way != _AS_IS:
        looked_for = [each.kind for each in screened]
        there = _leading(screen(fits_best.problem, (), jnp.asarray(fits_best.x), looked_for))
        kinds += [kind for kind in there if kind not in kinds]
    if not kinds:
        return None
    tried: list[tuple[float, _Way]] = []
    for way in ways:
        if way.error < _ABOUT_AS_WELL * lowest:
            best = screen(way.problem, (), jnp.asarray(way.x), kinds)[0]
            tried.append((way.error * float(np.sqrt(1.0 - best.share)), way))
    tried.sort(key=lambda each: each[0])
    error, way = tried[0]
    # a sign that is wrong is likelier than exchanged axes
    rivals = [each for each in tried[1:] if way.way[0] != _AS_IS[0] or each[1].way[0] == _AS_IS[0]]
    others = min((each[0] for each in rivals), default=np.inf)
    if way.way == _AS_IS or error > _WORTH_A_LOOK * min(left, others):
        return None
    return Reading(_as_axes(dataset, *way.way), error, left)


def _leading(screened: Sequence[Screened]) -> list[type[AbstractEffect]]:
    """The effects that explain most, of those looked at that explain anything worth the name."""
    told = [each for each in screened if each.share >= _TELLS]
    return [each.kind for each in sorted(told, key=lambda each: -each.share)[:_EFFECTS]]


class _Way(NamedTuple):
    """The base model where axis i is `way`[1][i] times what is now axis `way`[0][i]: the problem that is, its
    unknowns `x` [U], and the relative error it leaves."""

    way: OrderAndSigns
    problem: Problem
    x: Array
    error: float


def _ways() -> list[OrderAndSigns]:
    signs = [(x, y, 1.0) for x in (1.0, -1.0) for y in (1.0, -1.0)]
    return list(itertools.product(itertools.permutations(range(3)), signs))


def _fitted(problem: Problem, lines: Lines, way: OrderAndSigns) -> _Way:
    index, sign = np.asarray(way[0]), jnp.asarray(way[1])
    turned = eqx.tree_at(
        lambda p: (p.whitened, p.weight, p.bias_spread_n),
        problem,
        (problem.whitened[..., index] * sign, problem.weight[index], problem.bias_spread_n[index]),
    )
    found = fit(turned, (), base_starts(turned))
    left = float(np.sum(np.asarray(found.error_n2)) + lines.rest_n2.sum())
    return _Way(way, turned, found.x, float(np.sqrt(left / lines.energy_n2.sum())))


def _as_axes(dataset: Dataset, order: tuple[int, ...], sign: tuple[float, ...]) -> tuple[str, str, str]:
    columns = columns_to_process(np.eye(3), dataset.axes)
    # row: column of the file; entry: what it adds to each present process axis
    found = ["", "", ""]
    for axis, (place, turn) in enumerate(zip(order, sign, strict=True)):
        column = int(np.argmax(np.abs(columns[:, place])))
        found[column] = ("+" if turn * columns[column, place] > 0.0 else "-") + "xyz"[axis]
    return found[0], found[1], found[2]
