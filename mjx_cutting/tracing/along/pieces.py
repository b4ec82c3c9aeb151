"""Trials cut in pieces along their path, for effects whose response changes from place to place.

The lines of a whole trial are means over its path: a mode of the sheet that moves along it is blurred there.
In pieces the path is short, and the same search sees the mode move. Pieces keep the name of their trial,
which is what is held out, and the angle of the spindle as read from the whole of it.
"""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.on_path import fit_on_path
from mjx_cutting.tracing.fitting.prediction import predictions
from mjx_cutting.tracing.fitting.problem import Problem, model_at, shared_bias
from mjx_cutting.tracing.naming.candidate import parameters
from mjx_cutting.tracing.naming.search import Search
from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.tracing.records.lines import PIECE, Lines
from mjx_cutting.tracing.records.part import part_of
from mjx_cutting.tracing.records.spindle import spindle_angle
from mjx_cutting.trials.dataset import Dataset

_MOST = 6
_SAMPLES_PER_LINE = 3
_FEWEST_TURNS = 8
Array = NDArray[np.float64]


def in_pieces(dataset: Dataset, lines: Lines) -> Dataset | None:
    """The data set with every cut trial in equally many pieces; None where the records are too short."""
    turns = lines.speed_rev_s * lines.samples / dataset.sensor.sample_rate_hz
    heard = lines.present.sum(axis=1)
    count = int(min(_MOST, *(lines.samples / (_SAMPLES_PER_LINE * heard)), *(turns / _FEWEST_TURNS)))
    if count < 2:
        return None
    trials, speeds = [], iter(lines.speed_rev_s)
    for trial in dataset.trials:
        if trial.kind != "cut":
            trials.append(trial)
            continue
        place = np.asarray(along_path(trial), dtype=np.float64)
        angle = np.asarray(spindle_angle(trial, float(next(speeds))), dtype=np.float64)
        turning = replace(trial, spindle_angle_rad=angle)
        for index, part in enumerate(np.array_split(np.arange(len(place)), count), 1):
            piece = part_of(turning, place, slice(int(part[0]), int(part[-1]) + 1))
            trials.append(replace(piece, file=f"{trial.file}{PIECE}{index}"))
    return replace(dataset, trials=tuple(trials))


def of_whole_trials(
    found: Search, pieces: Lines, first: Search, dataset: Dataset, lines: Lines, anew: bool
) -> Search:
    """A search on the lines of `pieces` as one on the trials: their problem, the error of `first`'s base
    model, and that of the final model with its response moving along each held-out trial. `anew`: fitted to
    the trials first, as where the response changes by more within a piece than its mean tells."""
    problem = replace(
        first.problem,
        weight=found.problem.weight,
        scale=found.problem.scale,
        bias_unit_n=found.problem.bias_unit_n,
        given=found.problem.given,
    )
    fits, fold = found.final.fits, found.final.fold
    assert fits is not None
    whole = found.final_fit
    if anew:
        x, by_fold = map(
            jnp.asarray, fit_on_path(dataset, lines, problem, found.effects, np.asarray(whole.x), fold)
        )
        whole = replace(whole, x=x, model=model_at(problem, x, found.effects))
        made = jax.vmap(lambda each: model_at(problem, each, found.effects))
        fits = replace(fits, x=by_fold, model=made(by_fold))
    error = np.zeros_like(first.base.error_n2)
    for f in range(int(fold.max()) + 1):
        model = jax.tree.map(lambda leaf, f=f: leaf[f], fits.model)
        held = np.flatnonzero(fold == f)
        bias = shared_bias(problem, fits.x[f])
        told = predictions(dataset, lines, problem, model, bias, only=held)
        for index in held:
            error[index] = np.sum(told[index].residual_n ** 2, axis=0)
    final = HeldOut(error, first.base.energy_n2, fits, fold)
    own = parameters(found.problem, pieces, found.effects, whole, final) if anew else found.intervals
    return replace(
        found,
        problem=problem,
        base_fit=replace(first.base_fit, x=_in_units(first.base_fit.x, first.problem, problem)),
        base=first.base,
        final_fit=whole,
        final=final,
        intervals=tuple(own),
    )


def _in_units(x: ArrayLike, was: Problem, now: Problem) -> jax.Array:
    """Unknowns [U] of a base model in the units of another problem of the same kind."""
    common = was.scale / now.scale
    if was.shared_bias:
        common = jnp.concatenate([common, jnp.full(3, was.bias_unit_n / now.bias_unit_n)])
    return jnp.asarray(x).at[: len(common)].multiply(common)
