"""Records of a sensor without a filter: what of their edges lies beyond the highest line.

A straight tooth enters and leaves at once. A sensor without a filter samples that step as it is, and the
share of it that lies beyond the highest order a record can tell apart folds to any frequency: some per cent
of the force, which stands between the lines as noise would. The shape of it is known, exact at every angle,
for each constant of the base model; how much of each a trial has is fitted to what its lines leave, whatever
wears the teeth. That is taken off the records.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool
from mjx_cutting.tracing.fitting.believed_speeds import lines_as_it_turned
from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.prediction import predictions
from mjx_cutting.tracing.fitting.problem import CONSTANTS, Problem, pose, shared_bias
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.line_gain import helix_gain
from mjx_cutting.tracing.records.lines import turns
from mjx_cutting.trials.dataset import Dataset

_ANGLES = 1 << 15
_LESS = 0.99
_FINE = 16.0
Array = NDArray[np.floating]


def without_edges(dataset: Dataset, band_hz: tuple[float, float]) -> Dataset:
    """The trials less what their teeth do beyond the lines (call it in float64); as they are where the sensor
    has a filter, stated or not, that takes it away."""
    if dataset.sensor.anti_alias is not None or dataset.tool.kind in LEVEL_KINDS:
        return dataset
    lines = lines_as_it_turned(dataset, band_hz)
    problem, base = fit_base(pose(dataset, lines))
    shown = predictions(dataset, lines, problem, base.model, shared_bias(problem, base.x))
    shapes = _beyond(problem, lines.orders, [each.angle_rad for each in shown])
    edges = [_fitted(each, one.residual_n) for each, one in zip(shapes, shown, strict=True)]
    before = sum(float(np.sum(each.residual_n**2)) for each in shown)
    after = sum(float(np.sum((each.residual_n - edge) ** 2)) for each, edge in zip(shown, edges, strict=True))
    if after > _LESS * before:
        return dataset
    rest = iter(edges)
    trials = (
        replace(trial, force_n=trial.force_n - next(rest)) if trial.kind == "cut" else trial
        for trial in dataset.trials
    )
    return replace(dataset, trials=tuple(trials))


def _fitted(shapes: Array, left_n: Array) -> Array:
    """[T, 3] the combination of shapes [C, T, 3] that is nearest to what is left [T, 3], axis by axis."""
    found = np.zeros_like(left_n)
    for axis in range(left_n.shape[1]):
        columns = shapes[..., axis].T
        found[:, axis] = columns @ np.linalg.lstsq(columns, left_n[:, axis], rcond=1e-9)[0]
    return found


def _beyond(problem: Problem, orders: int, angles_rad: Sequence[Array]) -> list[Array]:
    """[C, T, 3] by trial: force at the angles [T] less its lines up to an order, for each constant at 1.

    What a helix has smeared is read off a fine turn; the edges of a straight tooth stand between its angles.
    """
    even = np.broadcast_to(2.0 * np.pi / _ANGLES * np.arange(_ANGLES), (problem.trials, _ANGLES))
    lines = np.fft.rfft(np.asarray(_forces(problem, even)), axis=2)
    tool, width_m = problem.tool, problem.cut.axial_width_m
    smear = float(np.asarray(width_m).min() * np.abs(np.tan(tool.helix_rad)) / tool.diameter_m)
    if smear * _ANGLES > _FINE:
        lines[:, :, : orders + 1] = 0.0
        gain = np.asarray(helix_gain(width_m, tool.diameter_m, tool.helix_rad, _ANGLES // 2))
        turn = np.fft.irfft(lines * gain[:, None, :, None], _ANGLES, axis=2)
        places = (np.round(each / (2.0 * np.pi) * _ANGLES).astype(int) % _ANGLES for each in angles_rad)
        found = [each[:, place] for each, place in zip(turn, places, strict=True)]
    else:
        longest = max(map(len, angles_rad))
        padded = np.stack([np.pad(each, (0, longest - len(each)), mode="edge") for each in angles_rad])
        exact = np.asarray(_forces(problem, padded))
        low = 2.0 / _ANGLES * lines[:, :, : orders + 1]
        low[:, :, 0] *= 0.5
        found = [
            force[:, : len(angle)] - np.real(np.einsum("cna,nt->cta", each, turns(angle, orders)))
            for force, each, angle in zip(exact, low, angles_rad, strict=True)
        ]
    return [each * np.array(problem.alive) for each in found]


@jax.jit
def _forces(problem: Problem, angles_rad: ArrayLike) -> jax.Array:
    """[R, C, T, 3] force of straight teeth at the angles [R, T], for each constant alone at 1."""
    straight = Tool(problem.tool.kind, problem.tool.teeth, problem.tool.diameter_m)

    def of_trial(each: tuple[Cut, jax.Array]) -> jax.Array:
        cut, angle = each

        def force(constants: jax.Array) -> jax.Array:
            model = ForceModel(straight, Material(*constants))
            return jax.vmap(lambda here: model.process_force(cut.replace(angle_rad=here)))(angle)

        return jax.lax.map(force, jnp.eye(CONSTANTS))

    return jax.lax.map(of_trial, (problem.cut, jnp.asarray(angles_rad)))
