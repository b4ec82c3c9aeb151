"""Sheets of several materials in one session: which of them are to have constants of their own.

Those are fitted beside the others (`fitting.sheets`) where one set of constants makes the force of a material
too large or too small, or leaves twice as much of it as constants of its own. Labels that tell sheets of the
same stuff apart, of which the forces differ by less, are taken for one; where the base model tells little of
what changes within the trials, as of teeth that pass faster than the sensor follows, labels are believed.
Trials of a material that few are of are left out, by name.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.along.engaged import SURELY_TURNS, engaged
from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.prediction import Prediction, energy, predictions
from mjx_cutting.tracing.fitting.problem import pose, shared_bias
from mjx_cutting.tracing.records.levels import LEVEL_KINDS, as_levels
from mjx_cutting.tracing.records.lines import compress
from mjx_cutting.tracing.telling.own_factor import own_factors
from mjx_cutting.trials.dataset import Dataset, LeftOut

_FEWEST = 4
_UNLIKE = 0.1
_BY_ITSELF = 0.5
_MOST = 0.5
_ERRORS = 3.0
_ONE_ZERO = 1e-9
Array = NDArray[np.floating]


def of_known_materials(dataset: Dataset, band_hz: tuple[float, float], asked: str | None = None) -> Dataset:
    """The trials of materials that enough are of, and those in the air; labels of sheets that are alike
    become one (call it in float64).

    Arguments:
        dataset: trials of any materials; `band_hz` in which they are compared.
        asked: the one material to take; default all.

    Raises:
        ValueError: no trial is of the material asked for.
    """
    cuts = [trial for trial in dataset.trials if trial.kind == "cut"]
    often = Counter(trial.material for trial in cuts if trial.material is not None)
    if asked is not None:
        if asked not in often:
            known = ", ".join(sorted(often)) or "none named"
            raise ValueError(
                f"material: got {asked!r}, expected one of the cut trials' ({known}); name one of those."
            )
        return _only(dataset, {asked}, f"expected {asked!r}, as asked for")
    if len(often) < 2:
        return dataset
    name, most = often.most_common(1)[0]
    if most < _FEWEST or not _unlike(dataset, _of(dataset, {name}), name, band_hz):
        return replace(dataset, trials=tuple(replace(each, material=name) for each in dataset.trials))
    enough = {each for each, count in often.items() if count >= _FEWEST}
    why = f"expected one that {_FEWEST} trials or more are of, since each has constants of its own"
    return _only(dataset, enough, why)


def _of(dataset: Dataset, names: Collection[str]) -> Dataset:
    trials = (each for each in dataset.trials if each.kind != "cut" or each.material in names)
    return replace(dataset, trials=tuple(trials))


def _only(dataset: Dataset, names: Collection[str], why: str) -> Dataset:
    """The trials of the materials named, and those in the air; the others left out."""
    others = tuple(
        LeftOut(
            each.file,
            f"got a sheet of {each.material!r}, {why}; trace the others by themselves (--material).",
        )
        for each in dataset.trials
        if each.kind == "cut" and each.material not in names
    )
    return replace(_of(dataset, names), left_out=(*dataset.left_out, *others))


def _unlike(dataset: Dataset, alone: Dataset, name: str, band_hz: tuple[float, float]) -> bool:
    """Whether one set of constants for all trials asks the force of another material for a factor clearly
    other than that of `name`, whatever else is missing in both; or leaves twice as much of that of `name` as
    one for its trials `alone`."""
    told = _by_one_set(dataset, band_hz)
    names = Counter(each.material for each in dataset.trials if each.kind == "cut")
    in_lines = dataset.tool.kind not in LEVEL_KINDS
    if in_lines and min(names.values()) >= _FEWEST and _shows_little(told):
        return True
    of = {trial.file: trial.material or "" for trial in dataset.trials}
    material = np.array([of[each.file] for each in told])
    if name not in material:
        return False
    factor, error = _factors(told) if in_lines else (own_factors(told).factor, np.zeros(len(told)))
    usual = {each: 1.0 + float(np.median(factor[material == each])) for each in np.unique(material)}
    sure = {each: float(np.sqrt(np.mean(error[material == each] ** 2))) for each in usual}
    for each, found in usual.items():
        away = abs(found / usual[name] - 1.0)
        if away > _UNLIKE and away > _ERRORS * np.hypot(sure[each], sure[name]):
            return True
    files = {trial.file for trial in alone.trials}
    with_others = energy([each.residual_n for each in told if each.file in files])
    by_itself = energy([each.residual_n for each in _by_one_set(alone, band_hz)])
    return by_itself < _BY_ITSELF**2 * with_others


def _factors(told: Sequence[Prediction]) -> tuple[Array, Array]:
    """[R] by how much of itself the force of each cut is larger than predicted, and the standard error of
    that; read from what changes within the trials where each has a zero of its own, which takes the mean."""
    bias = np.stack([each.bias_n for each in told])
    one_zero = bool(np.all(np.ptp(bias, axis=0) <= _ONE_ZERO * np.abs(bias).max()))
    found = []
    for each in told:
        force, left = each.predicted_n - each.bias_n, each.residual_n
        if not one_zero:
            force, left = force - force.mean(axis=0), left - left.mean(axis=0)
        size = max(float(np.sum(force**2)), 1e-300)
        factor = float(np.sum(force * left)) / size
        rest = float(np.sum(left**2)) - factor**2 * size
        found.append((factor, np.sqrt(max(rest, 0.0) / left.size / size)))
    factor, error = np.array(found).T
    return factor, error


def _shows_little(told: Sequence[Prediction]) -> bool:
    """Whether the base model leaves most of what changes within the trials: its factors say nothing then."""
    changes, left = (
        energy([each - each.mean(axis=0) for each in records])
        for records in ([each.measured_n for each in told], [each.residual_n for each in told])
    )
    return left > _MOST * changes


def _by_one_set(dataset: Dataset, band_hz: tuple[float, float]) -> tuple[Prediction, ...]:
    """The trials, where their tools are in the cut, by the base model with one set of constants."""
    trials = as_levels(
        replace(dataset, trials=tuple(replace(each, material=None) for each in dataset.trials))
    )
    part = None if dataset.tool.kind in LEVEL_KINDS else engaged(trials, SURELY_TURNS)
    trials = trials if part is None else part.dataset
    lines = compress(trials, band_hz)
    problem, base = fit_base(pose(trials, lines))
    return predictions(trials, lines, problem, base.model, shared_bias(problem, base.x))
