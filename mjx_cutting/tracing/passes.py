"""What one pass over a data set has found, and the two searches of which it is made."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import jax
import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect, ForceModel, Tool
from mjx_cutting.tracing.along.ends import entry_exit
from mjx_cutting.tracing.along.fed import as_chips_are_cut, as_fed, may_be_followed
from mjx_cutting.tracing.along.slow import search_slow
from mjx_cutting.tracing.along.slow_kinds import KINDS
from mjx_cutting.tracing.along.slow_round import SlowCandidate, SlowRound
from mjx_cutting.tracing.along.waves import courses
from mjx_cutting.tracing.fitting.believed_speeds import lines_as_it_turned
from mjx_cutting.tracing.fitting.heldout import HeldOut, folds
from mjx_cutting.tracing.fitting.prediction import Prediction, predictions
from mjx_cutting.tracing.fitting.problem import Problem, pose, shared_bias
from mjx_cutting.tracing.naming.lesser_part import refused
from mjx_cutting.tracing.naming.search import Search, search
from mjx_cutting.tracing.records.course import Course
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import Lines
from mjx_cutting.tracing.records.noise import noise_floor
from mjx_cutting.tracing.telling.verdict import final, reached
from mjx_cutting.trials.dataset import Dataset

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Pass:
    """What one pass found.

    Fields:
        dataset, lines: the trials and their lines.
        search, slow: outcome of the search over steady effects; rounds of the one along a trial.
        base_model, model: force model without and with the effects named.
        before, after: every cut trial beside the prediction of the two models.
        evidence: sentences that a search has for the effect it found, by name.
        noise_over: share of noise in the records judged over that in the `dataset`, which may be a part of
            them.
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
    noise_over: float = 1.0

    @property
    def along(self) -> tuple[SlowCandidate, ...]:
        """What was accepted after the steady effects."""
        return tuple(each.accepted for each in self.slow if each.accepted is not None)

    @property
    def kinds(self) -> tuple[type[AbstractEffect], ...]:
        """Effects named, in order of acceptance."""
        return (*self.search.effects, *(each.kind for each in self.along))

    @property
    def final(self) -> HeldOut:
        """Error on held-out trials of the model found."""
        return final(self.search, self.slow)

    @property
    def floor_nrmse(self) -> float:
        """Share of the force that the noise of the records judged is."""
        left = [each.residual_n for each in self.after] if self.along else []
        return self.noise_over * noise_floor(self.dataset, self.lines, left)

    def with_round(self, each: SlowRound, evidence: tuple[str, ...] = ()) -> Pass:
        """The pass with one more round, where it accepted something: model and predictions hold that too."""
        if each.accepted is None:
            return self
        told = self.evidence | {each.accepted.kind.name: evidence}
        waves = zip(self.after, each.accepted.added_n, strict=True)
        after = tuple(replace(one, predicted_n=one.predicted_n + wave) for one, wave in waves)
        model = self.model.with_effects(each.accepted.effect)
        return replace(self, slow=(*self.slow, each), model=model, after=after, evidence=told)


@dataclass(frozen=True)
class Searches:
    """The two searches of a pass, on any records: `names` are those of the effects tried along a trial,
    `droop_rev_s_nm` how far a motor gives way that swings within the turn."""

    band_hz: tuple[float, float]
    names: tuple[str, ...]
    seed: int
    progress: Callable[[str], None]
    posed: Callable[[Dataset, Lines], Problem] = pose
    droop_rev_s_nm: float = 0.0

    def steady(self, dataset: Dataset, kinds: Sequence[type[AbstractEffect]]) -> Pass:
        """The search over steady effects alone."""
        lines = lines_as_it_turned(dataset, self.band_hz)
        lines = replace(lines, droop_rev_s_nm=self.droop_rev_s_nm)
        found = search(self.posed(dataset, lines), lines, kinds, folds(dataset, self.seed), self.progress)
        problem = found.problem
        base_model, model = (for_use(dataset, fit.model) for fit in (found.base_fit, found.final_fit))
        before = predictions(dataset, lines, problem, base_model, shared_bias(problem, found.base_fit.x))
        bias = shared_bias(problem, found.final_fit.x)
        after = predictions(dataset, lines, problem, model, bias)
        alone = Pass(dataset, lines, found, (), base_model, model, before, after)
        return alone if self.posed is not pose else _as_fed(alone)

    def along(self, found: Pass, before: HeldOut, apart: bool = False, in_range: bool = True) -> Pass:
        """The pass with what is found along the trials beside its steady model, which leaves `before`."""
        dataset, problem, model = found.dataset, found.search.problem, found.search.final_fit.model
        ways = KINDS
        if dataset.tool.kind not in LEVEL_KINDS:
            ways = (*KINDS, entry_exit(found.lines, problem, model))
        trials = tuple(replace(each, apart=apart) for each in _courses(found))
        weight, tolerance = np.asarray(problem.weight), problem.tolerance
        rounds = search_slow(trials, before, weight, self.names, ways, self.progress, tolerance, in_range)
        for each in rounds:
            found = found.with_round(each)
        return replace(found, slow=rounds)


def _courses(found: Pass) -> tuple[Course, ...]:
    """The trials beside the steady model found."""
    fits, model = found.search.final.fits, found.search.final_fit.model
    assert fits is not None
    problem = found.search.problem
    trials = courses(found.dataset, found.lines, problem, model, found.after, fits.model)
    return as_chips_are_cut(trials, np.asarray(problem.weight))


def _as_fed(alone: Pass) -> Pass:
    """The pass over steady effects, its models following feed and speed where these were measured and change
    (`along.fed`): the base model too, whose chip it is."""
    if not may_be_followed(alone.dataset):
        return alone
    added = as_fed(_courses(alone), np.asarray(alone.search.problem.weight))
    if added is None:
        return alone
    found = alone.search
    before, base = _more(alone.before, found.base, added, alone.lines)
    after, final_ = _more(alone.after, found.final, added, alone.lines)
    return replace(alone, search=replace(found, base=base, final=final_), before=before, after=after)


def _more(
    predicted: Sequence[Prediction], error: HeldOut, added: Sequence[Array], lines: Lines
) -> tuple[tuple[Prediction, ...], HeldOut]:
    """Predictions and held-out error with forces [T, 3] added to every trial, or piece of one."""
    error_n2, found = np.array(error.error_n2), []
    for each, wave, owner in zip(predicted, added, lines.owner, strict=True):
        found.append(replace(each, predicted_n=each.predicted_n + wave))
        error_n2[owner] += np.sum(found[-1].residual_n ** 2 - each.residual_n**2, axis=0)
    return tuple(found), replace(error, error_n2=np.maximum(error_n2, 0.0))


def near_floor(found: Pass) -> bool:
    """Whether the pass leaves no more than noise and calculation do."""
    return found.final.nrmse <= reached(found.floor_nrmse, found.search.problem.tolerance)


def missing(found: Pass) -> float:
    """Share of the force's energy that is left on held-out trials beyond the noise."""
    return max(found.final.nrmse**2 - found.floor_nrmse**2, 0.0)


def for_use(dataset: Dataset, model: ForceModel) -> ForceModel:
    """The model with the tool's full axial resolution and plain numbers, as others will use it."""
    shape = dataset.tool
    tool = Tool(shape.kind, shape.teeth, float(shape.diameter_m), float(shape.helix_rad))
    plain = jax.tree.map(np.asarray, (model.material, model.effects))
    return ForceModel(tool, *plain)


def without_names(found: Pass, bare: Pass) -> Pass:
    """The pass without names, where all that they explain is how the force scatters from trial to trial."""
    rounds = found.search.rounds
    if found.search.effects:
        rounds = (
            refused(rounds[0], "the force of the trials scatters as a whole, and nothing else is left"),
        )
    return replace(bare, search=replace(bare.search, rounds=rounds))
