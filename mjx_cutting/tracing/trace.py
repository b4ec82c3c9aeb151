"""Tracing from end to end: measured trials in; verdict.json, model.json and report.html out."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np

from mjx_cutting import _platform
from mjx_cutting._files import write_atomic
from mjx_cutting.cutting import AbstractEffect, ForceModel, Tool, effect_class
from mjx_cutting.tracing.dependence import Dependence, dependences
from mjx_cutting.tracing.droop import NAME as DROOP
from mjx_cutting.tracing.droop import find_droop
from mjx_cutting.tracing.evidence import evidence
from mjx_cutting.tracing.heldout import HeldOut, folds
from mjx_cutting.tracing.isolability import isolability
from mjx_cutting.tracing.levels import LEVEL_KINDS, as_levels
from mjx_cutting.tracing.lines import Lines, compress, trusted_band
from mjx_cutting.tracing.prediction import Prediction, predictions
from mjx_cutting.tracing.problem import pose, shared_bias
from mjx_cutting.tracing.search import Search, search
from mjx_cutting.tracing.selfexcited import NAME as VIBRATION
from mjx_cutting.tracing.selfexcited import find_vibration
from mjx_cutting.tracing.slow import SlowRound, courses, search_slow
from mjx_cutting.tracing.verdict import final, testable, verdict
from mjx_cutting.trials.dataset import Dataset


@dataclass(frozen=True, eq=False)
class Tracing:
    """Everything a tracing found.

    Fields:
        dataset: the trials.
        lines, search: their lines, the outcome of the search over steady effects.
        slow: rounds of the search over effects that change along a trial.
        base_model, model: force model without and with the effects named.
        before, after: every cut trial beside the prediction of the two models.
        depends_before, depends_after: what the two residuals depend on.
        verdict: the dictionary written to verdict.json.
    """

    dataset: Dataset
    lines: Lines
    search: Search
    slow: tuple[SlowRound, ...]
    base_model: ForceModel
    model: ForceModel
    before: tuple[Prediction, ...]
    after: tuple[Prediction, ...]
    depends_before: tuple[Dependence, ...]
    depends_after: tuple[Dependence, ...]
    verdict: dict[str, Any]

    @property
    def kinds(self) -> tuple[type[AbstractEffect], ...]:
        """Effects named, in order of acceptance."""
        return (*self.search.effects, *(each.accepted.kind for each in self.slow if each.accepted))

    @property
    def final(self) -> HeldOut:
        """Error of the final model on held-out trials."""
        return final(self.search, self.slow)


def trace(
    dataset: Dataset,
    *,
    band_hz: tuple[float, float] | None = None,
    effects: Sequence[str] | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = lambda text: None,
) -> Tracing:
    """Find what the base model lacks on these trials.

    Arguments:
        dataset: trials of one tool; at least two of kind "cut".
        band_hz: band in which the sensor is trusted; default the anti-alias corner or half the sampling rate.
        effects: names to try; default every registered effect that the data can test.
        seed: for the folds of more than twelve trials.
        progress: told what is being tried.

    Raises:
        ValueError: unknown effect, fewer than two cut trials, or an empty band.
    """
    kinds = testable(dataset) if effects is None else [effect_class(name) for name in effects]
    # droop is not in lines read at the loaded speed, but in where they stand
    steady = [kind for kind in kinds if kind.steady and kind.name != DROOP]
    _check(dataset)
    dataset = as_levels(dataset)
    with _platform.x64():
        progress("reading the lines of every trial")
        lines = compress(dataset, trusted_band(dataset, band_hz))
        problem = pose(dataset, lines)
        found = search(problem, lines, steady, folds(dataset, seed), progress)
        problem = found.problem
        base_model = _named(dataset, found.base_fit.model)
        model = _named(dataset, found.final_fit.model)
        before = predictions(dataset, lines, problem, base_model, shared_bias(problem, found.base_fit.x))
        after = predictions(dataset, lines, problem, model, shared_bias(problem, found.final_fit.x))
        trials = courses(dataset, lines, problem, found.final_fit.model, after)
        weight = np.asarray(problem.weight)
        slow = search_slow(trials, found.final, weight, [kind.name for kind in kinds], progress)
        accepted = [each.accepted for each in slow if each.accepted is not None]
        after = tuple(
            replace(one, predicted_n=one.predicted_n + sum(each.added_n[index] for each in accepted))
            for index, one in enumerate(after)
        )
        model = model.with_effects(*(each.effect for each in accepted))
        shaken = None
        if any(kind.name == VIBRATION for kind in kinds) and dataset.tool.kind not in LEVEL_KINDS:
            progress("lines off the spindle's multiples")
            shaken = find_vibration(dataset, lines, after, final(found, slow), weight)
        if shaken is not None and shaken.round.accepted is not None:
            slow = (*slow, shaken.round)
            waves = zip(after, shaken.round.accepted.added_n, strict=True)
            after = tuple(replace(one, predicted_n=one.predicted_n + wave) for one, wave in waves)
        droop = find_droop(dataset, lines, found) if any(kind.name == DROOP for kind in kinds) else None
        if droop is not None and droop.round.accepted is not None:
            found, before = replace(found, base=droop.base), droop.before
            model = model.with_effects(droop.round.accepted.effect)
            slow = (droop.round, *slow)
        progress("testing what remains")
        teeth = dataset.tool.teeth
        depends_before = dependences(dataset, before, teeth, lines.orders)
        depends_after = dependences(dataset, after, teeth, lines.orders)
        named = (*found.effects, *(each.accepted.kind for each in slow if each.accepted))
        reasons = {kind.name: evidence(kind, dataset, before, after) for kind in named}
        if droop is not None and droop.round.accepted is not None:
            reasons[DROOP] = [*reasons[DROOP], *droop.evidence]
        if shaken is not None and shaken.round.accepted is not None:
            reasons[VIBRATION] = [*reasons[VIBRATION], *shaken.evidence]
        word = verdict(dataset, lines, found, slow, depends_before, depends_after, reasons)
    return Tracing(
        dataset, lines, found, slow, base_model, model, before, after, depends_before, depends_after, word
    )


def save(tracing: Tracing, out: Path) -> None:
    """Write verdict.json, model.json, report.html and isolability.json into the folder `out`."""
    from mjx_cutting.tracing.report import render

    page = render(tracing)
    out.mkdir(parents=True, exist_ok=True)
    write_atomic(out / "verdict.json", json.dumps(tracing.verdict, indent=2, allow_nan=False) + "\n")
    write_atomic(out / "model.json", json.dumps(tracing.model.to_dict(), indent=2, allow_nan=False) + "\n")
    write_atomic(out / "report.html", page)
    found = isolability(tracing.search)
    if found is not None:
        write_atomic(out / "isolability.json", json.dumps(found.to_dict(), indent=2) + "\n")


def _check(dataset: Dataset) -> None:
    cuts = sum(trial.kind == "cut" for trial in dataset.trials)
    if cuts < 2:
        raise ValueError(f"{cuts} cut trial; tracing holds out by trial and needs at least two")


def _named(dataset: Dataset, model: ForceModel) -> ForceModel:
    """The model with the tool's full axial resolution and plain numbers, as others will use it."""
    shape = dataset.tool
    tool = Tool(shape.kind, shape.teeth, float(shape.diameter_m), float(shape.helix_rad))
    plain = jax.tree.map(np.asarray, (model.material, model.effects))
    return ForceModel(tool, *plain)
