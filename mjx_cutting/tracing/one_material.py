"""Sheets of several materials in one session: a force model has the constants of one.

Trials whose records name other materials than most do are left out, by name, where one set of constants
makes their force too large or too small, or leaves twice as much of one material's as constants of its own.
Labels that tell sheets of the same stuff apart, of which the forces differ by less, leave nothing out.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from mjx_cutting.tracing.along.engaged import SURELY_TURNS, engaged
from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.prediction import Prediction, energy, predictions
from mjx_cutting.tracing.fitting.problem import pose, shared_bias
from mjx_cutting.tracing.records.levels import LEVEL_KINDS, as_levels
from mjx_cutting.tracing.records.lines import compress
from mjx_cutting.tracing.telling.own_factor import own_factors
from mjx_cutting.trials.dataset import Dataset, LeftOut, Trial

_FEWEST = 4
_UNLIKE = 0.1
_BY_ITSELF = 0.5


def of_one_material(dataset: Dataset, band_hz: tuple[float, float], asked: str | None = None) -> Dataset:
    """The trials of one material and those in the air (call it in float64).

    Arguments:
        dataset: trials of any materials; `band_hz` in which they are compared.
        asked: the material; default that of most trials, where the others are unlike it.

    Raises:
        ValueError: no trial is of the material asked for.
    """
    cuts = [trial for trial in dataset.trials if trial.kind == "cut"]
    often = Counter(trial.material for trial in cuts if trial.material is not None)
    if asked is not None and asked not in often:
        known = ", ".join(sorted(often)) or "none named"
        raise ValueError(
            f"material: got {asked!r}, expected one of the cut trials' ({known}); name one of those."
        )
    if asked is None and len(often) < 2:
        return dataset
    name = often.most_common(1)[0][0] if asked is None else asked
    alone = replace(dataset, trials=tuple(each for each in dataset.trials if _may_stay(each, name)))
    if asked is None and (often[name] < _FEWEST or not _unlike(dataset, alone, name, band_hz)):
        return dataset
    kept = {trial.file for trial in alone.trials}
    others = tuple(
        LeftOut(
            each.file,
            f"got a sheet of {each.material!r}, expected {name!r}, as {often[name]} trials have: a model has "
            "the constants of one material; trace the others by themselves (--material).",
        )
        for each in cuts
        if each.file not in kept
    )
    return replace(alone, left_out=(*dataset.left_out, *others))


def _may_stay(trial: Trial, name: str) -> bool:
    return trial.kind != "cut" or trial.material == name


def _unlike(dataset: Dataset, alone: Dataset, name: str, band_hz: tuple[float, float]) -> bool:
    """Whether one set of constants for all trials asks the force of another material for a factor clearly
    other than that of `name`, whatever else is missing in both; or leaves twice as much of that of `name` as
    one for its trials `alone`."""
    told = _by_one_set(dataset, band_hz)
    factor = 1.0 + own_factors(told).factor
    of = {trial.file: trial.material or "" for trial in dataset.trials}
    material = np.array([of[each.file] for each in told])
    usual = {each: float(np.median(factor[material == each])) for each in np.unique(material)}
    if name not in usual:
        return False
    if any(abs(each / usual[name] - 1.0) > _UNLIKE for each in usual.values()):
        return True
    files = {trial.file for trial in alone.trials}
    with_others = energy([each.residual_n for each in told if each.file in files])
    by_itself = energy([each.residual_n for each in _by_one_set(alone, band_hz)])
    return by_itself < _BY_ITSELF**2 * with_others


def _by_one_set(dataset: Dataset, band_hz: tuple[float, float]) -> tuple[Prediction, ...]:
    """The trials, where their tools are in the cut, by the base model with one set of constants."""
    trials = as_levels(dataset)
    part = None if dataset.tool.kind in LEVEL_KINDS else engaged(trials, SURELY_TURNS)
    trials = trials if part is None else part.dataset
    lines = compress(trials, band_hz)
    problem, base = fit_base(pose(trials, lines))
    return predictions(trials, lines, problem, base.model, shared_bias(problem, base.x))
