"""Torque ripple, read in the measured angle of the spindle.

A finely measured angle holds the ripple, and along it the lines stand still: of the ripple no more is left in
the force than what the chips gain and lose, which with many teeth is next to nothing. What the angle shows is
theta = th + (eps / p) sin(p th + phase), with one order p and one eps in all trials, at every speed. An
encoder with a fault shows such an angle too, but then the force does not follow it.

Held-out error: "before" is the base model where the spindle is taken as turning evenly, as it must be without
ripple, "after" that of what was found along the angle as measured.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting.effects.torque_ripple import TorqueRipple
from mjx_cutting.tracing.along.slow_round import BeforeOthers, SlowCandidate, SlowRound
from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.heldout import held_out, on_other_lines
from mjx_cutting.tracing.fitting.prediction import Prediction, predictions
from mjx_cutting.tracing.fitting.problem import pose, shared_bias
from mjx_cutting.tracing.naming.decision import decide
from mjx_cutting.tracing.naming.intervals import Interval, interval
from mjx_cutting.tracing.naming.search import Search
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import Lines, compress
from mjx_cutting.tracing.records.turns import CHANCE, even_angle, holds_ripple
from mjx_cutting.trials.dataset import Dataset, Trial

_ORDERS = np.arange(2, 15)
_CLEARLY = 4.0
Array = NDArray[np.floating]


def find_ripple(
    dataset: Dataset, lines: Lines, found: Search, after: tuple[Prediction, ...]
) -> BeforeOthers | None:
    """The ripple that the measured angles hold (call it in float64); None where they hold none of one order.

    Arguments: the trials and the search over their lines; predictions with what it found.
    """
    trials = [trial for trial in dataset.trials if trial.kind == "cut"]
    if dataset.tool.kind in LEVEL_KINDS or not all(holds_ripple(trial) for trial in trials):
        return None
    waves = np.array([_waves(trial) for trial in trials])
    size = np.sqrt(np.mean(np.abs(waves) ** 2, axis=0))
    strongest = int(np.argmax(size))
    if size[strongest] < _CLEARLY * np.median(size):
        return None
    order, wave = int(_ORDERS[strongest]), waves[:, strongest]
    eps = order * np.abs(wave)
    zero = [float(np.mean(each.angle_rad - _angle(trial))) for each, trial in zip(after, trials, strict=True)]
    phases = np.exp(1j * (np.angle(wave) - order * np.array(zero)))
    told = _told(order, eps, phases, found.final.fold)
    evenly = replace(dataset, trials=tuple(_evenly(trial) for trial in dataset.trials))
    still = compress(evenly, lines.band_hz, lines.speed_rev_s, like=lines)
    problem, base = fit_base(pose(evenly, still))
    rigid = on_other_lines(pose(evenly, still), still, found.effects, found.final)
    decision = decide(TorqueRipple, rigid, found.final, CHANCE, told)
    effect = TorqueRipple(float(eps.mean()), float(order), float(np.angle(phases.mean())))
    silent = tuple(np.zeros((len(trial.time_s), 3)) for trial in trials)
    candidate = SlowCandidate(TorqueRipple, effect, found.final, decision, silent)
    return BeforeOthers(
        SlowRound(rigid, (candidate,), candidate if decision.accepted else None),
        held_out(problem, still, (), base.x, found.base.fold),
        predictions(evenly, still, problem, base.model, shared_bias(problem, base.x)),
        (
            f"the measured angle of the spindle runs ahead and falls behind {order} times a turn, at "
            f"{lines.speed_rev_s.min():.3g} to {lines.speed_rev_s.max():.3g} rev/s alike: its speed ripples "
            f"by {eps.min():.2%} to {eps.max():.2%}, and the force follows it; the error before is that of a "
            "spindle that turns evenly",
        ),
    )


def _told(order: int, eps: Array, phases: NDArray, fold: NDArray[np.int64]) -> dict[str, Interval]:
    """The parameters, from eps [R] and exp(i phase) [R] of the trials, each in its fold [R]."""
    folds = [fold != each for each in range(int(fold.max()) + 1)]
    away = np.angle(phases * np.conj(phases.mean()))
    many = max(len(eps) - 1, 1)
    by_name = {
        "amplitude": (eps.mean(), [eps[use].mean() for use in folds], np.std(eps) / np.sqrt(many)),
        "order": (order, [order for _ in folds], 0.0),
        "phase_rad": (
            np.angle(phases.mean()),
            [np.angle(phases[use].mean()) for use in folds],
            np.std(away) / np.sqrt(many),
        ),
    }
    return {
        name: interval(TorqueRipple, name, float(whole), np.array(parts, dtype=float), float(error))
        for name, (whole, parts, error) in by_name.items()
    }


def _waves(trial: Trial) -> Array:
    """[orders] (eps / p) exp(i phase) of each order p in the trial's measured angle, rad."""
    even, uneven = even_angle(trial)
    window = np.hanning(len(even))
    turns = np.exp(-1j * np.multiply.outer(_ORDERS, even))
    return np.asarray(2j * (turns @ (window * uneven)) / window.sum())


def _angle(trial: Trial) -> Array:
    assert trial.spindle_angle_rad is not None
    return np.unwrap(trial.spindle_angle_rad)


def _evenly(trial: Trial) -> Trial:
    """The trial with the straight line through its measured angle."""
    if trial.spindle_angle_rad is None:
        return trial
    even: NDArray[np.float64] = even_angle(trial)[0].astype(np.float64)
    return replace(trial, spindle_angle_rad=even)
