"""Records of a sensor without a filter: what of their edges lies beyond the highest line.

A straight tooth enters and leaves at once. A sensor without a filter samples that step as it is, and the
share of it that lies beyond the highest order a record can tell apart folds to any frequency: some per cent
of the force, which stands between the lines as noise would. The shape of it is known, exact at every angle,
for each constant of the base model; how much of each a trial has is fitted to what its lines leave, whatever
wears the teeth. That is taken off the records.
"""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import pinvh

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool
from mjx_cutting.tracing.fitting.believed_speeds import lines_as_it_turned
from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.prediction import Prediction, predictions
from mjx_cutting.tracing.fitting.problem import CONSTANTS, Problem, pose, shared_bias
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.line_gain import helix_gain
from mjx_cutting.tracing.records.lines import compress
from mjx_cutting.trials.dataset import Dataset

_PLACES = 1 << 17
_LESS = 0.9
_TURN_RAD = np.linspace(-0.004, 0.004, 17)
_STRETCH_RAD = np.linspace(-0.02, 0.02, 81)
Array = NDArray[np.floating]


def without_edges(dataset: Dataset, band_hz: tuple[float, float]) -> Dataset:
    """The trials less what their teeth do beyond the lines (call it in float64); as they are where the sensor
    has a filter, stated or not, that takes it away."""
    if dataset.sensor.anti_alias is not None or dataset.tool.kind in LEVEL_KINDS:
        return dataset
    lines = lines_as_it_turned(dataset, band_hz)
    problem, base = fit_base(pose(dataset, lines))
    shown = predictions(dataset, lines, problem, base.model, shared_bias(problem, base.x))
    edges = iter([_edges(problem, index, lines.orders, each) for index, each in enumerate(shown)])
    trials = (
        replace(trial, force_n=trial.force_n - next(edges)) if trial.kind == "cut" else trial
        for trial in dataset.trials
    )
    cleared = replace(dataset, trials=tuple(trials))
    rest = compress(cleared, band_hz, about_rev_s=lines.speed_rev_s, like=lines).rest_n2
    return cleared if rest.sum() < _LESS * lines.rest_n2.sum() else dataset


def _edges(problem: Problem, trial: int, orders: int, shown: Prediction) -> Array:
    """[T, 3] what a trial shows of the shapes beyond its lines, at the angles that meet it best: lines among
    which edges fold do not tell these as closely as the edges themselves."""
    shapes = _beyond(problem, trial, orders)
    left, pitch = shown.residual_n, 2.0 * np.pi / problem.tool.teeth
    way = np.linspace(-0.5, 0.5, len(left))

    def at(turn: float, stretch: float) -> Array:
        angle = shown.angle_rad + turn + stretch * way
        return _fitted(shapes[:, np.round(angle / pitch * _PLACES).astype(int) % _PLACES], left)

    def missed(each: tuple[float, float]) -> float:
        return float(np.sum((left - at(*each)) ** 2))

    best = (0.0, 0.0)
    for _ in range(2):
        best = min(((best[0], each) for each in (best[1], *_STRETCH_RAD)), key=missed)
        best = min(((each, best[1]) for each in (best[0], *_TURN_RAD)), key=missed)
    return at(*best)


def _fitted(shapes: Array, left_n: Array) -> Array:
    """[T, 3] the combination of shapes [C, T, 3] that is nearest to what is left [T, 3], axis by axis."""
    found = np.zeros_like(left_n)
    for axis in range(left_n.shape[1]):
        columns = shapes[..., axis]
        columns = columns[np.any(columns != 0.0, axis=1)]
        gram = columns @ columns.T
        weights = pinvh(gram, rtol=1e-9) @ (columns @ left_n[:, axis])
        found[:, axis] = weights @ columns
    return found


def _beyond(problem: Problem, trial: int, orders: int) -> Array:
    """[C, P, 3] force of a trial over a pitch less its lines up to an order, for each constant alone at 1."""
    tool, cut = problem.tool, jax.tree.map(lambda leaf: leaf[trial], problem.cut)
    lines = np.fft.rfft(np.asarray(_over_a_pitch(tool, cut)), axis=1)
    lines[:, : orders // tool.teeth + 1] = 0.0
    # the lines of a pitch are those at multiples of the teeth
    gain = helix_gain(cut.axial_width_m, tool.diameter_m / tool.teeth, tool.helix_rad, _PLACES // 2)
    force = np.fft.irfft(lines * np.asarray(gain)[0][:, None], _PLACES, axis=1)
    return force * np.array(problem.alive)


@jax.jit
def _over_a_pitch(tool: Tool, cut: Cut) -> jax.Array:
    """[C, P, 3] force of straight teeth at even angles of a pitch, for each constant alone at 1."""
    straight = Tool(tool.kind, tool.teeth, tool.diameter_m)
    angle = 2.0 * jnp.pi / tool.teeth / _PLACES * jnp.arange(_PLACES)

    def force(constants: jax.Array) -> jax.Array:
        model = ForceModel(straight, Material(*constants))
        return jax.vmap(lambda here: model.process_force(cut.replace(angle_rad=here)))(angle)

    return jax.lax.map(force, jnp.eye(CONSTANTS))
