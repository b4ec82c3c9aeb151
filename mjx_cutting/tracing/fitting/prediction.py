"""What a force model predicts for measured trials, sample by sample, with each trial's phase, speed and bias
fitted on it.

The prediction is the model's lines evaluated at the trial's spindle angle, y(t) = bias + Re(c_0 + 2 sum c_n
exp(i n (th + phase))), within the band. It is what scores, figures and the disturbance GP (measured minus
predicted) are made from. Where an effect changes along the path (a response by position, wear by the length
cut), so do the lines.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjx_cutting import _platform
from mjx_cutting.cutting import AbstractEffect, ForceModel
from mjx_cutting.cutting.effects.spindle_droop import SpindleDroop, UnderLoad
from mjx_cutting.tracing.fitting.model_lines import by_position, model_lines
from mjx_cutting.tracing.fitting.moving import MovingLines, wave
from mjx_cutting.tracing.fitting.problem import Problem, cuts_of
from mjx_cutting.tracing.fitting.residual import Residual, residual_of_lines
from mjx_cutting.tracing.fitting.tuned import tuned_angle
from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.tracing.records.lines import Lines, band_limit
from mjx_cutting.tracing.records.spindle import spindle_angle
from mjx_cutting.trials.dataset import Dataset

KNOTS = 257
FEW_KNOTS = 3
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Prediction:
    """One cut trial beside its prediction, both within the band.

    Fields:
        file: name of the trial.
        time_s: [T] from the start of the record.
        angle_rad: [T] angle of tooth 0 as fitted.
        measured_n, predicted_n: [T, 3] force on the tool in process axes; the bias is in the prediction.
        speed_rev_s: estimated spindle speed.
        bias_n: [3] fitted bias.
    """

    file: str
    time_s: Array
    angle_rad: Array
    measured_n: Array
    predicted_n: Array
    speed_rev_s: float
    bias_n: Array

    @property
    def residual_n(self) -> Array:
        """[T, 3] measured minus predicted, N."""
        return self.measured_n - self.predicted_n


def energy(records: Sequence[Array]) -> float:
    """Sum of the squares of forces [T, 3], N^2."""
    return sum(float(np.sum(each**2)) for each in records)


def predictions(
    dataset: Dataset,
    lines: Lines,
    problem: Problem,
    model: ForceModel,
    shared_bias_n: ArrayLike = 0.0,
    only: Collection[int] | None = None,
    turn_rad: ArrayLike = 0.0,
) -> tuple[Prediction, ...]:
    """Predictions of every cut trial under a `model` of effects that lines hold (call it in float64).

    The speeds are those of `lines`, but where lines move along the path. `only`: places of the trials that
    matter, whose angle is found again under moving lines; default all; `turn_rad` [R]: by how much further
    than fitted the tool of each trial is turned."""
    model = _at_loaded_speed(model)
    knots = KNOTS if by_position(model) else FEW_KNOTS if grows(model.effects) else 0
    places = along_the_path(problem, model, knots) if knots else None
    lines_n, left = _solved(problem, model, jnp.asarray(shared_bias_n), places)
    coefficients = np.asarray(lines_n)
    phases, biases = np.asarray(left.phase_rad) + turn_rad, np.array(left.bias_n)
    rate_hz, weight = dataset.sensor.sample_rate_hz, np.asarray(problem.weights)
    trials = [trial for trial in dataset.trials if trial.kind == "cut"]
    results = []
    for index, trial in enumerate(trials):
        speed = float(lines.speed_rev_s[index])
        angle = spindle_angle(trial, speed) + phases[index]
        measured = band_limit(trial.force_n, rate_hz, lines.band_hz)
        if places is None:
            force = wave(lines, index, angle, coefficients[index], rate_hz)
        else:
            moving = MovingLines(lines, index, np.asarray(places[index]), along_path(trial), rate_hz)
            if by_position(model) and (only is None or index in only):
                known = trial.spindle_angle_rad is not None
                angle = tuned_angle(moving, angle, known, problem.tool.teeth, measured, weight[index])
                speed = float(np.ptp(angle) / np.ptp(trial.time_s) / (2.0 * np.pi))
            force = moving.force(angle)
            if by_position(model) and not problem.shared_bias:
                biases[index] = (measured - force).mean(axis=0)
        results.append(
            Prediction(
                file=trial.file,
                time_s=trial.time_s - trial.time_s[0],
                angle_rad=angle,
                measured_n=measured,
                predicted_n=force + biases[index],
                speed_rev_s=speed,
                bias_n=biases[index],
            )
        )
    return tuple(results)


def loaded_about(dataset: Dataset, model: ForceModel, stated_rev_s: Array, error: float = 0.0) -> Array:
    """[R] speeds of the cut trials, stated as `stated_rev_s`, slowed by the model's droop where it has one,
    rev/s. `error` is the relative error of the stated speeds."""
    stated = (1.0 + error) * stated_rev_s
    droop = droop_of(model)
    if droop is None:
        return stated
    return np.asarray(droop.loaded_speed_rev_s(cuts_of(dataset, stated), without_droop(model)))


def droop_of(model: ForceModel) -> SpindleDroop | None:
    """What slows the model's spindle."""
    return next((each for each in model.effects if isinstance(each, SpindleDroop)), None)


def without_droop(model: ForceModel) -> ForceModel:
    """The model of a spindle that does not give way."""
    rest = tuple(each for each in model.effects if not isinstance(each, SpindleDroop))
    return ForceModel(model.tool, model.material, rest)


def _at_loaded_speed(model: ForceModel) -> ForceModel:
    """The model for lines that stand where the loaded spindle turned: it may swing within the turn."""
    droop = droop_of(model)
    if droop is None or not np.any(np.asarray(droop.bandwidth_hz) > 0.0):
        return without_droop(model)
    return without_droop(model).with_effects(UnderLoad(droop.droop_rev_s_nm, droop.bandwidth_hz))


def grows(effects: Iterable[AbstractEffect | type[AbstractEffect]]) -> bool:
    """Whether one of the effects grows with the length cut, in a trial as well."""
    return any("cut length" in effect.needs for effect in effects)


@partial(_platform.jit, static_argnums=2)
def along_the_path(problem: Problem, model: ForceModel, knots: int) -> jax.Array:
    """[R, K, orders + 1, 3] lines at even steps along the path of every trial, N."""

    def at(share: jax.Array) -> jax.Array:
        away = share * problem.path_m
        there = problem.cut.replace(
            position_m=problem.cut.position_m + away, cut_length_m=problem.cut.cut_length_m + away
        )
        return model_lines(eqx.tree_at(lambda p: p.cut, problem, there), model, at_one_place=True)

    return jnp.moveaxis(jax.lax.map(at, jnp.linspace(-0.5, 0.5, knots)), 0, 1)


@_platform.jit_for_few_calls
def _solved(
    problem: Problem, model: ForceModel, shared_bias_n: jax.Array, places: jax.Array | None
) -> tuple[jax.Array, Residual]:
    """Lines, or their mean over the path, and what they leave."""
    lines = model_lines(problem, model) if places is None else jnp.mean(places, axis=1)
    return lines, residual_of_lines(problem, lines, shared_bias_n)
