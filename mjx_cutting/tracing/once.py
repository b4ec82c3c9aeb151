"""One pass over a data set: the search over steady effects, then the one over effects along a trial."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import jax
import numpy as np

from mjx_cutting.cutting import AbstractEffect, ForceModel, Tool
from mjx_cutting.tracing.course import KINDS
from mjx_cutting.tracing.ends import entry_exit
from mjx_cutting.tracing.heldout import HeldOut, folds
from mjx_cutting.tracing.levels import LEVEL_KINDS
from mjx_cutting.tracing.lines import Lines, compress
from mjx_cutting.tracing.prediction import Prediction, predictions
from mjx_cutting.tracing.problem import pose, shared_bias
from mjx_cutting.tracing.search import Search, search
from mjx_cutting.tracing.slow import SlowRound, courses, search_slow
from mjx_cutting.tracing.verdict import final
from mjx_cutting.trials.dataset import Dataset


@dataclass(frozen=True, eq=False)
class Pass:
    """What one pass found.

    Fields:
        dataset, lines: the trials and their lines.
        search, slow: outcome of the search over steady effects; rounds of the one along a trial.
        base_model, model: force model without and with the effects named.
        before, after: every cut trial beside the prediction of the two models.
        evidence: sentences that a search has for the effect it found, by name.
    """

    dataset: Dataset
    lines: Lines
    search: Search
    slow: tuple[SlowRound, ...]
    base_model: ForceModel
    model: ForceModel
    before: tuple[Prediction, ...]
    after: tuple[Prediction, ...]
    evidence: dict[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def kinds(self) -> tuple[type[AbstractEffect], ...]:
        """Effects named, in order of acceptance."""
        return (*self.search.effects, *(each.accepted.kind for each in self.slow if each.accepted))

    @property
    def final(self) -> HeldOut:
        """Error on held-out trials of the model found."""
        return final(self.search, self.slow)

    def with_round(self, each: SlowRound, evidence: tuple[str, ...] = ()) -> Pass:
        """The pass with one more round, where it accepted something: model and predictions hold that too."""
        if each.accepted is None:
            return self
        told = self.evidence | {each.accepted.kind.name: evidence}
        waves = zip(self.after, each.accepted.added_n, strict=True)
        after = tuple(replace(one, predicted_n=one.predicted_n + wave) for one, wave in waves)
        model = self.model.with_effects(each.accepted.effect)
        return replace(self, slow=(*self.slow, each), model=model, after=after, evidence=told)


def once(
    dataset: Dataset,
    band_hz: tuple[float, float],
    kinds: Sequence[type[AbstractEffect]],
    steady: Sequence[type[AbstractEffect]],
    seed: int,
    progress: Callable[[str], None],
) -> Pass:
    """Search over `steady` effects, then over those of `kinds` along a trial (call it in float64)."""
    progress("reading the lines of every trial")
    lines = compress(dataset, band_hz)
    found = search(pose(dataset, lines), lines, steady, folds(dataset, seed), progress)
    problem = found.problem
    base_model, model = (_named(dataset, fit.model) for fit in (found.base_fit, found.final_fit))
    before = predictions(dataset, lines, problem, base_model, shared_bias(problem, found.base_fit.x))
    after = predictions(dataset, lines, problem, model, shared_bias(problem, found.final_fit.x))
    along = KINDS
    if dataset.tool.kind not in LEVEL_KINDS:
        along = (*KINDS, entry_exit(lines, problem, found.final_fit.model))
    trials = courses(dataset, lines, problem, found.final_fit.model, after)
    names = [kind.name for kind in kinds]
    rounds = search_slow(trials, found.final, np.asarray(problem.weight), names, along, progress)
    result = Pass(dataset, lines, found, (), base_model, model, before, after)
    for each in rounds:
        result = result.with_round(each)
    return replace(result, slow=rounds)


def _named(dataset: Dataset, model: ForceModel) -> ForceModel:
    """The model with the tool's full axial resolution and plain numbers, as others will use it."""
    shape = dataset.tool
    tool = Tool(shape.kind, shape.teeth, float(shape.diameter_m), float(shape.helix_rad))
    plain = jax.tree.map(np.asarray, (model.material, model.effects))
    return ForceModel(tool, *plain)
