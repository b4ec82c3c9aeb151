"""The force of the best steady model in every trial, split into what chip and edge have of it, and if asked
into what each direction has.

Effects along a trial act on these waves, so how large one is, as a share, is known no better than they are.
Where each trial has a bias of its own behind a slow sensor, that is ten per cent and more: the fits with a
fold left out say how much.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray

from mjx_cutting import _platform
from mjx_cutting.cutting import AbstractEffect, Cut, ForceModel, Material, effect_class
from mjx_cutting.cutting.chip import Chip
from mjx_cutting.cutting.effects.abstract import EdgeForce
from mjx_cutting.cutting.effects.layered_material import TORQUE_POWER
from mjx_cutting.tracing.along.at_teeth import AtTeeth
from mjx_cutting.tracing.fitting.model_lines import model_lines
from mjx_cutting.tracing.fitting.moving import wave
from mjx_cutting.tracing.fitting.prediction import Prediction, without_droop
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.fitting.sheets import Sheets
from mjx_cutting.tracing.records.course import Course, beside_path, felt_at
from mjx_cutting.tracing.records.even_time import later
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.line_gain import filter_delay_s
from mjx_cutting.tracing.records.lines import Lines
from mjx_cutting.trials.dataset import Dataset

Complex = NDArray[np.complexfloating]
_OF_TEETH = ("spindle", "chip", "edge")
Array = NDArray[np.floating]


def courses(
    dataset: Dataset,
    lines: Lines,
    problem: Problem,
    model: ForceModel,
    after: Sequence[Prediction],
    folds: ForceModel | None = None,
) -> tuple[Course, ...]:
    """The cut trials as slow effects see them, under the best steady model and its predictions.

    `folds` is the same model fitted without each fold, leaves [F, ...]; None where it was not fitted.
    """
    chip_lines, edge_lines = _chip_and_edge(problem, model)
    chip_share, edge_share = _by_fold(problem, folds, chip_lines, edge_lines)
    trials = [trial for trial in dataset.trials if trial.kind == "cut"]
    teeth = None if dataset.tool.kind in LEVEL_KINDS else AtTeeth(problem, model, _chip_and_edge)
    rate_hz = dataset.sensor.sample_rate_hz
    ahead_m = (0.0, 0.0) if teeth is None else teeth.ahead_m
    directions = cache(partial(_directions, problem, model))

    def by_direction(index: int, angle_rad: Array) -> Array:
        columns = np.moveaxis(directions()[:, index], 0, -1)
        found = wave(lines, index, angle_rad, columns.reshape(len(columns), -1), rate_hz)
        return found.reshape(-1, 3, 3)

    damping = cache(partial(_damping, problem, model))

    def damped(index: int, angle_rad: Array) -> Array:
        columns = np.moveaxis(damping()[:, index], 0, -1)
        found = wave(lines, index, angle_rad, columns.reshape(len(columns), -1), rate_hz)
        return found.reshape(-1, 3, 2)

    border_power = (1.0, 1.0, 1.0)
    if dataset.tool.kind == "drill":
        border_power = (1.0, TORQUE_POWER, 1.0)  # nothing, torque, thrust
    delay_s, found = filter_delay_s(dataset.sensor), []
    for index, (trial, each) in enumerate(zip(trials, after, strict=True)):
        chip_n, edge_n = (
            wave(lines, index, each.angle_rad, of_it[index], rate_hz) for of_it in (chip_lines, edge_lines)
        )
        at_teeth = None if teeth is None else partial(teeth.waves, lines, index, each.angle_rad, rate_hz)
        measured = trial.feed_speed_measured_m_s
        found.append(
            Course(
                time_s=each.time_s,
                position_m=felt_at(trial, delay_s),
                feed_share=None if measured is None else measured / trial.feed_speed_m_s - 1.0,
                chip_n=chip_n,
                edge_n=edge_n,
                left_n=each.residual_n,
                rate_hz=rate_hz,
                band_hz=lines.band_hz,
                index=index,
                angle_rad=each.angle_rad,
                delay_s=delay_s,
                alias=dataset.sensor.anti_alias,
                pitch_s=1.0 / (dataset.tool.teeth * each.speed_rev_s),
                later=later(trial),
                chip_by_fold=chip_share[:, index],
                edge_by_fold=edge_share[:, index],
                ahead_m=ahead_m,
                at_teeth=at_teeth,
                by_direction=cache(partial(by_direction, index, each.angle_rad)),
                border_power=border_power,
                beside_m=beside_path(trial, dataset.axes, delay_s),
                damped_n=cache(partial(damped, index, each.angle_rad)),
            )
        )
    return tuple(found)


def _chip_and_edge(problem: Problem, model: ForceModel) -> tuple[Complex, Complex]:
    """[R, orders + 1, 3] lines of the chip's force and of the edge's, N. The edge's is what is left of the
    teeth's at no resistance of the chip: so is the force on a worn land."""
    constants = model.material
    edge = Material(0.0, constants.K_te_n_m, 0.0, constants.K_re_n_m, 0.0, constants.K_ae_n_m)
    of_edge, whole = (
        _lines_of(problem, ForceModel(model.tool, material, model.effects)) for material in (edge, constants)
    )
    return whole - of_edge, of_edge - _beside(problem, model)


class _Only(AbstractEffect):
    """Of the force of every tooth what is along each direction, tangential, radial, axial, times a share."""

    stage = "edge"

    share: ArrayLike

    def edge(self, force: EdgeForce, chip: Chip, cut: Cut, model: ForceModel) -> EdgeForce:
        return EdgeForce(force.chip * self.share, force.edge * self.share)


class _Plunging(AbstractEffect):
    """The force of process damping alone, of a tool that moves into the sheet at 1 m/s."""

    stage = "edge"

    damping: AbstractEffect

    def edge(self, force: EdgeForce, chip: Chip, cut: Cut, model: ForceModel) -> EdgeForce:
        none = EdgeForce(jnp.zeros_like(force.chip), jnp.zeros_like(force.edge))
        return self.damping.edge(none, chip, _plunging(cut), model)

    def body(self, force: jax.Array, cut: Cut, model: ForceModel) -> jax.Array:
        return self.damping.body(force, _plunging(cut), model)


def _plunging(cut: Cut) -> Cut:
    return cut.replace(vibration_x_m_s=0.0, vibration_y_m_s=1.0)


def _damping(problem: Problem, model: ForceModel) -> Complex:
    """[2, R, orders + 1, 3] lines of process damping of 1 N/m at 1 m/s, of each tooth and of the tool, N."""
    ways = [effect_class("process_damping")(1.0, of_tool) for of_tool in (0.0, 1.0)]
    found = [_lines_of(problem, model.with_effects(_Plunging(each))) for each in ways]
    return np.stack(found) - _beside(problem, model)


def _directions(problem: Problem, model: ForceModel) -> Complex:
    """[3, R, orders + 1, 3] lines of the tangential, radial and axial force of the teeth, N."""
    found = [_lines_of(problem, model.with_effects(_Only(jnp.asarray(one)))) for one in np.eye(3)]
    return np.stack(found) - _beside(problem, model)


def _beside(problem: Problem, model: ForceModel) -> Complex:
    """[R, orders + 1, 3] lines of what is not of the teeth, N: drift, unbalance, what rubs on the sides."""
    if all(each.stage in _OF_TEETH for each in model.effects):
        return np.zeros((problem.trials, problem.orders + 1, 3), complex)
    return _lines_of(problem, model.with_effects(_Only(jnp.zeros(3))))


def _lines_of(problem: Problem, model: ForceModel) -> Complex:
    """[R, orders + 1, 3] lines of a model, N, of an even turn, without the inertia of what the sensor
    carries: of no edge."""
    beside = [each for each in problem.given if not issubclass(each, Sheets)]
    own = tuple(each for each in without_droop(model).effects if type(each) not in beside)
    return np.asarray(_lines(problem, ForceModel(model.tool, model.material, own)))


def _by_fold(
    problem: Problem, folds: ForceModel | None, chip_lines: Complex, edge_lines: Complex
) -> tuple[Array, Array]:
    """[F, R, 3] the chip's and the edge's force with each fold left out, as shares of those of all trials."""
    count = 0 if folds is None else len(np.asarray(folds.material.K_tc_n_m2))
    shares = np.ones((2, count, problem.trials, 3))
    for fold in range(count):
        model = jax.tree.map(lambda leaf, fold=fold: leaf[fold], folds)
        for side, (of_fold, of_all) in enumerate(
            zip(_chip_and_edge(problem, model), (chip_lines, edge_lines), strict=True)
        ):
            energy = np.sum(np.abs(of_all) ** 2, axis=1)
            common = np.sum((of_fold * of_all.conj()).real, axis=1)
            shares[side, fold] = np.divide(common, energy, out=shares[side, fold], where=energy > 0.0)
    return shares[0], shares[1]


@_platform.jit_for_few_calls
def _lines(problem: Problem, model: ForceModel) -> jax.Array:
    return model_lines(problem, model)
