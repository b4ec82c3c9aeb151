"""Are the columns of force what the data set says they are?

A sensor mounted another way round, or the force on the sheet taken for the one on the tool, leaves a base
model that fits badly, whatever effect is then added. So where much is left with all effects found, the base
model is fitted again to the forces read in every other way: axes exchanged, signs turned. One that leaves
less than a third of the error is told; nothing is turned round unasked. The sign along the tool's axis cannot
be told from lines, for the axial constants may have either. Of a turning tool, of which other standards have
the axes otherwise, the main cutting force is found (`levels`), and what was made of the columns is told.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from mjx_cutting.tracing.fitting.fit import base_starts, fit
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import Lines
from mjx_cutting.trials.dataset import Dataset, columns_to_process

_BAD = 0.1
_BETTER = 1.0 / 3.0


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
    why = turned if dataset.tool.kind == "turning" else "as which the base model fits far better"
    return (
        f"the columns of force were read as {list(dataset.axes or ())}, {why}: say so in `axes` in "
        "dataset.json, or check how the sensor is mounted"
    )


def read_as(dataset: Dataset, axes: tuple[str, str, str]) -> Dataset:
    """The data set, which says nothing of its axes, with the columns of force read as `axes`."""
    noise = dataset.sensor.noise_std_n
    if noise is not None and len(noise) == 3:
        x, y, z = np.abs(columns_to_process(np.asarray(noise), axes)).tolist()
        noise = (x, y, z)
    trials = (replace(t, force_n=columns_to_process(t.force_n, axes)) for t in dataset.trials)
    sensor = replace(dataset.sensor, noise_std_n=noise)
    return replace(dataset, axes=axes, sensor=sensor, trials=tuple(trials))


def better_reading(dataset: Dataset, lines: Lines, problem: Problem, left: float) -> Reading | None:
    """The way to read the forces that fits far better than the present one (call it in float64).

    `left`: relative error of the model found.
    """
    if dataset.tool.kind in LEVEL_KINDS or problem.motion is not None or left < _BAD:
        return None
    now = _error(problem, lines, (0, 1, 2), (1.0, 1.0, 1.0))
    if now < _BAD:
        return None
    signs = [(x, y, 1.0) for x in (1.0, -1.0) for y in (1.0, -1.0)]
    ways = list(itertools.product(itertools.permutations(range(3)), signs))
    errors = [_error(problem, lines, *way) for way in ways]
    best = int(np.argmin(errors))
    if errors[best] > _BETTER * now:
        return None
    return Reading(_as_axes(dataset, *ways[best]), errors[best], now)


def _error(problem: Problem, lines: Lines, order: tuple[int, ...], sign: tuple[float, ...]) -> float:
    """Relative error of the base model where axis i is `sign`[i] times what is now axis `order`[i]."""
    index = np.asarray(order)
    turned = eqx.tree_at(
        lambda p: (p.whitened, p.weight, p.bias_spread_n),
        problem,
        (
            problem.whitened[..., index] * jnp.asarray(sign),
            problem.weight[index],
            problem.bias_spread_n[index],
        ),
    )
    found = fit(turned, (), base_starts(turned))
    left = float(np.sum(np.asarray(found.error_n2)) + lines.rest_n2.sum())
    return float(np.sqrt(left / lines.energy_n2.sum()))


def _as_axes(dataset: Dataset, order: tuple[int, ...], sign: tuple[float, ...]) -> tuple[str, str, str]:
    columns = columns_to_process(np.eye(3), dataset.axes)
    # row: column of the file; entry: what it adds to each present process axis
    found = ["", "", ""]
    for axis, (place, turn) in enumerate(zip(order, sign, strict=True)):
        column = int(np.argmax(np.abs(columns[:, place])))
        found[column] = ("+" if turn * columns[column, place] > 0.0 else "-") + "xyz"[axis]
    return found[0], found[1], found[2]
