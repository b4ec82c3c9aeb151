"""Records of a sensor without a filter: what of their edges lies beyond the highest line.

A straight tooth enters and leaves at once. A sensor without a filter samples that step as it is, but for its
own rise time (a mean over a part of the sampling interval, the same in all trials), and the share of it that
lies beyond the highest order a record can tell apart folds to any frequency: some per cent of the force,
which stands between the lines as noise would. The shape of it is known, exact at every angle, for each
constant of a model; how much of each a trial has is fitted to what its lines leave, whatever wears the teeth.
That is taken off the records: as the base model has it first, then as a model found in what is left has it,
whose teeth are unlike each other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import pinvh

from mjx_cutting import _platform
from mjx_cutting.cutting import AbstractEffect, Cut, ForceModel, Material, Tool
from mjx_cutting.tracing.fitting.believed_speeds import lines_as_it_turned
from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.prediction import Prediction, energy, predictions
from mjx_cutting.tracing.fitting.problem import CONSTANTS, Problem, pose, shared_bias
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.line_gain import helix_gain
from mjx_cutting.tracing.records.lines import Lines, compress
from mjx_cutting.tracing.records.part import without_force
from mjx_cutting.trials.dataset import Dataset

_PLACES = 1 << 17
_PLACES_A_TURN = 1 << 18
_AT_ONCE = 1 << 13
_LESS = 0.9
_BETWEEN = 0.5
_TURN_RAD = np.linspace(-0.004, 0.004, 17)
_STRETCH_RAD = np.linspace(-0.02, 0.02, 81)
_CLOSER_RAD = (2e-4, 1e-4, 4e-5, 2e-5, 1e-5)
_STEPS = np.stack(np.meshgrid([-1.0, 0.0, 1.0], [-2.0, 0.0, 2.0]), axis=-1).reshape(-1, 2)
_WIDTHS = (0.0, 0.012, 0.025, 0.05, 0.1, 0.2, 0.4)
_CLOSER_WIDTHS = (0.25, 0.12, 0.06)
_SHOWING = 2
Array = NDArray[np.floating]
Place = tuple[float, float]


def without_edges(dataset: Dataset, band_hz: tuple[float, float]) -> Dataset:
    """The trials less what their teeth do beyond the lines (call it in float64); as they are where the sensor
    has a filter, stated or not, that takes it away."""
    if dataset.sensor.anti_alias is not None or dataset.tool.kind in LEVEL_KINDS:
        return dataset
    lines = lines_as_it_turned(dataset, band_hz)
    problem, base = fit_base(pose(dataset, lines))
    cleared = _less_edges(dataset, lines, problem, base.model, shared_bias(problem, base.x))
    return dataset if cleared is None else cleared


def as_found(
    dataset: Dataset, lines: Lines, problem: Problem, model: ForceModel, bias_n: ArrayLike
) -> Dataset | None:
    """The trials less what unlike teeth do beyond the lines; None where `model` holds nothing by which teeth
    differ, or what it says is no better.

    Arguments: `dataset` as measured; `lines`, `problem`, `model` and `bias_n` [3] as found on the trials less
        what `without_edges` takes off.
    """
    if not model.effects or not all(_of_the_teeth(each) for each in model.effects):
        return None
    return _less_edges(dataset, lines, problem, model, bias_n)


def _of_the_teeth(effect: AbstractEffect) -> bool:
    """Whether an effect changes the chip or the law under an edge, and so the edges of the force."""
    return effect.stage in ("chip", "edge")


def _less_edges(
    dataset: Dataset, lines: Lines, problem: Problem, model: ForceModel, bias_n: ArrayLike
) -> Dataset | None:
    """The trials less the edges of a model's teeth; None where that does not leave a tenth less between the
    lines than there was, or in all where edges fold onto lines, as they do in a record of nearly so many
    samples a turn."""
    shown = predictions(dataset, lines, problem, model, bias_n)
    # teeth that are all alike repeat at every pitch
    a_turn = 1 if model.effects else problem.tool.teeth

    def beyond(trial: int) -> NDArray[np.complexfloating]:
        return _beyond(problem, model, trial, lines.orders, a_turn)

    wide_s = _width_s(beyond, a_turn, shown, dataset.sensor.sample_rate_hz)
    edges = [_Edges(beyond(index), a_turn, each, wide_s).best() for index, each in enumerate(shown)]
    cleared = without_force(dataset, edges)

    def between_lines(trials: Dataset) -> float:
        there = compress(trials, lines.band_hz, about_rev_s=lines.speed_rev_s, like=lines)
        return float(there.rest_n2.sum())

    if between_lines(cleared) < _LESS * lines.rest_n2.sum():
        return cleared
    cuts = [trial for trial in dataset.trials if trial.kind == "cut"]
    alone = without_force(dataset, [cut.force_n - each for cut, each in zip(cuts, edges, strict=True)])
    if between_lines(alone) > _BETWEEN * energy(edges):
        return None
    left = [each.residual_n - edge for each, edge in zip(shown, edges, strict=True)]
    return cleared if energy(left) < _LESS * energy([each.residual_n for each in shown]) else None


def _width_s(
    beyond: Callable[[int], NDArray[np.complexfloating]],
    a_turn: int,
    shown: Sequence[Prediction],
    rate_hz: float,
) -> float:
    """Time over which the sensor averages, s, by what the first trials show of their edges."""
    few = [(beyond(index), a_turn, each) for index, each in enumerate(shown[:_SHOWING])]
    places = [_Edges(*each, 0.0).place() for each in few]

    @cache
    def missed(wide_s: float) -> float:
        edges = (_Edges(*each, wide_s) for each in few)
        return sum(one.missed(one.closer(place)) for one, place in zip(edges, places, strict=True))

    best = min((share / rate_hz for share in _WIDTHS), key=missed)
    for closer in _CLOSER_WIDTHS:
        best = min((best, best * (1.0 - closer), best * (1.0 + closer)), key=missed)
    return best


class _Edges:
    """What a trial shows of the shapes beyond its lines, seen by a sensor that averages over a time."""

    def __init__(self, lines: NDArray[np.complexfloating], a_turn: int, shown: Prediction, wide_s: float):
        """`lines` as of `_beyond`, of shapes of which there are so many `a_turn`."""
        averaged = np.sinc(np.arange(lines.shape[1]) * a_turn * shown.speed_rev_s * wide_s)
        constant, self.axis = np.nonzero(np.any(lines != 0.0, axis=1))
        # [P, K] what each constant shows along an axis; a place side by side, as it is looked up
        self.shapes = np.ascontiguousarray(np.fft.irfft(lines[constant, :, self.axis] * averaged, axis=1).T)
        self.left, self.period = shown.residual_n, 2.0 * np.pi / a_turn
        self.energy = float(np.sum(self.left**2))
        self.angle, self.way = shown.angle_rad, np.linspace(-0.5, 0.5, len(shown.residual_n))

    def best(self) -> Array:
        """[T, 3] at the angles that meet it best: lines among which edges fold do not tell these as closely
        as the edges themselves."""
        return self.at(self.closer(self.place()))

    def place(self) -> Place:
        """Turn and stretch of the angles that meet it best, of few."""
        best: Place = (0.0, 0.0)
        for _ in range(2):
            best = min(((best[0], each) for each in (best[1], *_STRETCH_RAD)), key=self.missed)
            best = min(((each, best[1]) for each in (best[0], *_TURN_RAD)), key=self.missed)
        return best

    def closer(self, place: Place) -> Place:
        """The best near a place. A step is met by the sample before it or by the one behind, so that counts
        as closely as samples stand in a pitch."""
        for closer in _CLOSER_RAD:
            near = np.asarray(place) + closer * _STEPS
            place = min(((float(turn), float(stretch)) for turn, stretch in near), key=self.missed)
        return place

    def at(self, place: Place) -> Array:
        """[T, 3] what is shown at the angles turned and stretched so: of each axis the combination of its
        shapes that is nearest to what is left."""
        columns = self._columns(place)
        return columns @ self._strengths(*self._products(columns))

    def missed(self, place: Place) -> float:
        """Squared error that is left then."""
        square, product = self._products(self._columns(place))
        return self.energy - float(np.sum(product * self._strengths(square, product)))

    def _columns(self, place: Place) -> Array:
        """[T, K] the shapes at the angles turned and stretched so."""
        angle = self.angle + place[0] + place[1] * self.way
        places = len(self.shapes)
        return self.shapes[np.round(angle / self.period * places).astype(int) % places]

    def _products(self, columns: Array) -> tuple[Array, Array]:
        """[K, K] of the shapes with each other, [K, 3] with what is left."""
        return columns.T @ columns, columns.T @ self.left

    def _strengths(self, square: Array, product: Array) -> Array:
        """[K, 3] of each shape along its axis."""
        found = np.zeros_like(product)
        for axis in range(product.shape[1]):
            own = np.flatnonzero(self.axis == axis)
            found[own, axis] = pinvh(square[np.ix_(own, own)], rtol=1e-9) @ product[own, axis]
        return found


def _beyond(
    problem: Problem, model: ForceModel, trial: int, orders: int, a_turn: int
) -> NDArray[np.complexfloating]:
    """[C, P / 2 + 1, 3] lines of a trial's force over a turn, or that part of it of which it has so many
    `a_turn`, less those up to an order, for each constant alone at 1."""
    tool, cut = problem.tool, jax.tree.map(lambda leaf: leaf[trial], problem.cut)
    places = _PLACES if a_turn > 1 else _PLACES_A_TURN
    lines = np.fft.rfft(np.asarray(_each_alone(tool, model.effects, cut, a_turn, places)), axis=1)
    lines[:, : orders // a_turn + 1] = 0.0
    gain = helix_gain(cut.axial_width_m, tool.diameter_m / a_turn, tool.helix_rad, places // 2)
    return np.asarray(lines * np.asarray(gain)[0][:, None] * np.array(problem.alive))


@partial(_platform.jit, static_argnames=("a_turn", "places"))
def _each_alone(
    tool: Tool, effects: tuple[AbstractEffect, ...], cut: Cut, a_turn: int, places: int
) -> jax.Array:
    """[C, P, 3] force of straight teeth at even angles of a part of a turn, for each constant alone at 1."""
    straight = Tool(tool.kind, tool.teeth, tool.diameter_m)
    angle = 2.0 * jnp.pi / a_turn / places * jnp.arange(places)

    def force(constants: jax.Array) -> jax.Array:
        model = ForceModel(straight, Material(*constants), effects)
        at = jax.vmap(lambda here: model.process_force(cut.replace(angle_rad=here)))
        return jax.lax.map(at, angle.reshape(-1, _AT_ONCE)).reshape(-1, 3)

    return jax.lax.map(force, jnp.eye(CONSTANTS))
