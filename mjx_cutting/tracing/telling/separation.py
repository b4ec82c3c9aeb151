"""Which further trial would tell two explanations apart, and by how much.

Both models, as fitted, predict each of a menu of cheap trials: a trial at hand repeated at another feed,
depth or speed, or without cutting. What one predicts is taken as measured and explained by the other, its
phase and bias free as in any trial; what is left, in standard deviations of the lines, is what the trial is
expected to bring (the noise-free log-likelihood ratio is half its square). Both models keep their fitted
constants.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from mjx_cutting import _platform
from mjx_cutting.cutting import Cut, ForceModel, arc
from mjx_cutting.tracing.fitting.model_lines import model_lines
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.fitting.residual import as_measured, residual_of_lines
from mjx_cutting.tracing.records.line_gain import line_gain
from mjx_cutting.tracing.records.lines import Lines
from mjx_cutting.trials.dataset import Dataset

_MENU = (
    ("at a tenth of the feed", {"feed": 0.1}),
    ("at a third of the feed", {"feed": 1.0 / 3.0}),
    ("at three times the feed", {"feed": 3.0}),
    ("at a quarter of the depth", {"depth": 0.25}),
    ("at twice the depth", {"depth": 2.0}),
    ("3 % faster, at the same feed per tooth", {"feed": 1.03, "speed": 1.03}),
    ("at 0.6 times the speed, at the same feed per tooth", {"feed": 0.6, "speed": 0.6}),
    ("at 1.6 times the speed, at the same feed per tooth", {"feed": 1.6, "speed": 1.6}),
    ("in air, at the same speed", {"depth": 0.0}),
)
_DEEPEST = 0.9


@dataclass(frozen=True)
class Separation:
    """A trial and what it would bring. Fields: `trial` in words; `sigma` expected distance of the two models'
    predictions, in standard deviations."""

    trial: str
    sigma: float


def separations(
    dataset: Dataset,
    lines: Lines,
    problem: Problem,
    first: ForceModel,
    second: ForceModel,
    shared_bias_n: tuple[ArrayLike, ArrayLike],
) -> tuple[Separation, ...]:
    """Every trial of the menu, the most telling first.

    Arguments:
        dataset, lines, problem: the trials at hand (call it in float64).
        first, second: the two explanations, as fitted.
        shared_bias_n: [3] bias of the session under each, N.
    """
    trials = [trial for trial in dataset.trials if trial.kind == "cut"]
    problem = replace(
        problem, motion=None, trust=None
    )  # how the tool will move in a further trial is unknown
    like = _middle(problem)
    cut = jax.tree.map(lambda leaf: np.asarray(leaf)[like], problem.cut)
    slot = trials[like].milling == "slot"
    menu = [(words, _changed(cut, dataset, trials[like].milling, slot, **how)) for words, how in _MENU]
    menu = [(words.replace("depth", "width") if slot else words, each) for words, each in menu]
    cuts = jax.tree.map(lambda *leaves: jnp.asarray(leaves, dtype=float), *(each for _, each in menu))
    record = problem.path_m, problem.factor, problem.present, problem.whitened

    def repeated(leaf: jax.Array) -> jax.Array:
        return jnp.repeat(leaf[like : like + 1], len(menu), axis=0)

    speeds = np.asarray(cuts.spindle_speed_rev_s)
    further = eqx.tree_at(
        lambda p: (p.cut, p.gain, p.path_m, p.factor, p.present, p.whitened),
        problem,
        (cuts, jnp.asarray(line_gain(dataset.sensor, speeds, problem.orders)), *map(repeated, record)),
    )
    sigma = np.asarray(_apart(further, first, second, *map(jnp.asarray, shared_bias_n)))
    found = [
        Separation(f"{lines.files[like]} again {words}", float(each))
        for (words, _), each in zip(menu, sigma, strict=True)
    ]
    return tuple(sorted(found, key=lambda each: -each.sigma))


def _middle(problem: Problem) -> int:
    """The trial nearest the middle of all conditions."""
    away = np.zeros(problem.trials)
    for value in (problem.cut.feed_speed_m_s, problem.cut.radial_depth_m, problem.cut.spindle_speed_rev_s):
        logs = np.log(np.maximum(np.asarray(value), 1e-12))
        away += np.abs(logs - np.median(logs))
    return int(np.argmin(away))


def _changed(
    cut: Any, dataset: Dataset, milling: str | None, slot: bool, feed: float = 1.0, depth: float = 1.0,
    speed: float = 1.0,
) -> Cut:  # fmt: skip
    diameter = dataset.tool.diameter_m
    radial = float(cut.radial_depth_m)
    radial = radial if slot else min(radial * depth, _DEEPEST * diameter)
    entry, exit_ = arc(milling or "slot", radial, diameter)
    if depth == 0.0:
        exit_ = entry
    changed: Cut = cut.replace(
        feed_speed_m_s=float(cut.feed_speed_m_s) * feed,
        spindle_speed_rev_s=float(cut.spindle_speed_rev_s) * speed,
        radial_depth_m=radial,
        axial_width_m=float(cut.axial_width_m) * (depth if slot and depth > 0.0 else 1.0),
        entry_rad=float(entry),
        exit_rad=float(exit_),
    )
    return changed


@_platform.jit_for_few_calls
def _apart(
    problem: Problem, first: ForceModel, second: ForceModel, bias_n: jax.Array, other_n: jax.Array
) -> jax.Array:
    """[M] distance of the two models' predictions of every trial, in standard deviations."""
    seen = model_lines(problem, second).at[:, 0].add(other_n)
    measured = eqx.tree_at(lambda p: p.whitened, problem, as_measured(problem, seen))
    left = residual_of_lines(measured, model_lines(problem, first), bias_n)
    return jnp.sqrt(jnp.sum(left.weighted**2, axis=(1, 2)))
