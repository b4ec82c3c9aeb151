"""What a whole force model predicts for measured trials: its lines, and what it has along the trials.

What changes along a trial (a layer, mains, a stair) stands beside the lines of the steady cut, as tracing
finds it: a few columns at the effect's own shape. The phase, speed and bias of a trial are read on what that
leaves, and it is taken at the phase so read; so twice. Mains starts each trial at a phase of its own, which
is fitted. Of the ends of a sheet much of a record may be missing, and lines that stay do not tell its phase
and speed: theirs move along the path. A measured feed or speed, where the force goes with it, is the base
model's own chip and followed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting import _platform
from mjx_cutting.cutting import AbstractEffect, ForceModel
from mjx_cutting.cutting.effects.entry_exit import EntryExit
from mjx_cutting.tracing.along.fed import as_chips_are_cut, as_fed, may_be_followed
from mjx_cutting.tracing.along.kind import Kind
from mjx_cutting.tracing.along.offset import as_late, delay_s
from mjx_cutting.tracing.along.ramps import MovingEnds
from mjx_cutting.tracing.along.shapes import phases
from mjx_cutting.tracing.along.slow_kinds import kind_of
from mjx_cutting.tracing.along.slow_round import less_force
from mjx_cutting.tracing.along.stair import STAIR
from mjx_cutting.tracing.along.waves import courses
from mjx_cutting.tracing.fitting.prediction import Prediction, loaded_about, predictions
from mjx_cutting.tracing.fitting.problem import Problem, pose
from mjx_cutting.tracing.records.course import Course
from mjx_cutting.tracing.records.followed_angle import as_followed
from mjx_cutting.tracing.records.heard_speed import as_heard
from mjx_cutting.tracing.records.levels import as_levels
from mjx_cutting.tracing.records.lines import Lines, band_limit, compress, trusted_band
from mjx_cutting.tracing.records.part import without_force
from mjx_cutting.tracing.records.spindle import as_turned, stated_speed
from mjx_cutting.trials.dataset import Dataset

_TIMES = 2
Array = NDArray[np.floating]


def predict_trials(
    dataset: Dataset, model: ForceModel, band_hz: tuple[float, float] | None = None
) -> tuple[Prediction, ...]:
    """Predictions of every cut trial of a dataset under `model`, with all its effects but vibration that the
    cut keeps up, of which no model holds the phase, and stiction at the start of hysteresis.

    Arguments:
        dataset: measured trials.
        model: force model, from tracing or from a model.json; the tool is the data set's.
        band_hz: band compared, Hz; default the anti-alias filter's corner or half the sampling rate.

    A trial's speed is looked for within 1 % of the stated one, or of what the model's droop makes of it.
    Positions are counted as in the trials that the model was found on.

    Raises:
        ValueError: an empty band, or a stair of the feed where none was measured.
    """
    with _platform.x64():
        dataset = as_heard(as_followed(as_turned(as_levels(as_late(dataset, delay_s(model))))))
        band_hz, rate_hz = trusted_band(dataset, band_hz), dataset.sensor.sample_rate_hz
        bare, steady, along = _parted(model)
        _check_fed(dataset, along)
        whole, lines, problem = _steady(dataset, steady, band_hz)
        if not along and not may_be_followed(dataset):
            return whole
        after = whole
        for _ in range(_TIMES):
            seen = [replace(each, measured_n=one.measured_n) for each, one in zip(after, whole, strict=True)]
            weight = np.asarray(problem.weight)
            trials = as_chips_are_cut(courses(dataset, lines, problem, bare, seen), weight)
            added = _added(trials, along, weight)
            added = [force * np.array(problem.alive) for force in added]
            after, lines, problem = _steady(without_force(dataset, added), steady, band_hz)
        heard = [band_limit(force, rate_hz, band_hz) for force in added]
        return tuple(
            replace(each, measured_n=one.measured_n, predicted_n=each.predicted_n + force)
            for each, one, force in zip(after, whole, heard, strict=True)
        )


def _parted(model: ForceModel) -> tuple[ForceModel, ForceModel, list[AbstractEffect]]:
    """The model without the effects that are looked for along the trials; that with the ends of the sheet;
    the others of these effects."""
    ends = [each for each in model.effects if isinstance(each, EntryExit)]
    along = [each for each in model.effects if kind_of(each) is not None]
    steady = [each for each in model.effects if all(each is not one for one in (*ends, *along))]
    bare = ForceModel(model.tool, model.material, tuple(steady))
    return bare, bare.with_effects(*(MovingEnds(**each.values()) for each in ends)), along


def _check_fed(dataset: Dataset, along: Sequence[AbstractEffect]) -> None:
    cuts = [trial for trial in dataset.trials if trial.kind == "cut"]
    unfed = [trial.file for trial in cuts if trial.feed_speed_measured_m_s is None]
    if unfed and any(each.name == STAIR.name for each in along):
        raise ValueError(
            f"the model holds {STAIR.name}, and {unfed[0]} has no measured feed; expected one in every cut "
            "trial: leave the effect out of the model, or the trial out of the data set"
        )


def _steady(
    dataset: Dataset, model: ForceModel, band_hz: tuple[float, float]
) -> tuple[tuple[Prediction, ...], Lines, Problem]:
    """Predictions under a model of effects that lines hold, and these lines."""
    stated = np.array([stated_speed(trial) for trial in dataset.trials if trial.kind == "cut"])
    moving = any(isinstance(each, MovingEnds) for each in model.effects)
    lines = compress(dataset, band_hz, loaded_about(dataset, model, stated), every=moving)
    problem = pose(dataset, lines)
    found = predictions(dataset, lines, problem, model)
    if problem.shared_bias:
        # a sensor zeroed once a session has one bias: the mean of what is left of all trials
        bias = np.mean([each.residual_n.mean(axis=0) for each in found], axis=0)
        found = predictions(dataset, lines, problem, model, bias)
    return found, lines, problem


def _added(trials: Sequence[Course], along: Sequence[AbstractEffect], weight: Array) -> list[Array]:
    """[T, 3] by trial the force of effects `along` the trials, and of a measured feed and speed, N."""
    ways = [(kind, each) for each in along if (kind := kind_of(each)) is not None]
    # a phase is read on what the others leave
    ways.sort(key=lambda way: way[0].own_phase)
    left, added = list(trials), [np.zeros_like(each.left_n) for each in trials]
    for kind, effect in ways:
        force = _force(kind, effect, left, weight)
        left, added = less_force(left, force), [one + more for one, more in zip(added, force, strict=True)]
    fed = None if any(kind is STAIR for kind, _ in ways) else as_fed(left, weight)
    return added if fed is None else [one + more for one, more in zip(added, fed, strict=True)]


def _force(kind: Kind, effect: AbstractEffect, trials: Sequence[Course], weight: Array) -> list[Array]:
    """[T, 3] by trial the force of an effect, N."""
    assert kind.parts is not None
    shape, c = kind.parts(effect)
    of_each = [c] * len(trials)
    if kind.own_phase:
        of_each = list(phases(kind.sums_of(trials, shape[None]), 0, c, weight) @ c)
    return [kind.columns(course, shape) @ own for course, own in zip(trials, of_each, strict=True)]
