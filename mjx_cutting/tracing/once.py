"""One pass over a data set: the search over steady effects, then the one over effects along a trial.

Of a sensor without a filter, what the teeth do beyond the highest line is taken off first (`edges`).

A steady model fitted to records that hold an effect along the trial has taken part of it for its own (a layer
lowers the constants), or does not see a steady effect beneath it. So what was found is taken out of the
records, the steady search made again on the rest, and that along the trial beside its outcome; only then are
its parameters held against their physical ranges. Where much is left, trials are cut in pieces along the path
for effects whose response changes along it (`pieces`). Steady effects that take next to nothing of what is
missing are dropped in the end (`lesser_part`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect, ForceModel, Tool
from mjx_cutting.tracing.along.ends import NAME as ENDS
from mjx_cutting.tracing.along.ends import entry_exit
from mjx_cutting.tracing.along.pieces import in_pieces, of_whole_trials
from mjx_cutting.tracing.along.ramps import ends_in_pieces
from mjx_cutting.tracing.along.slow import SlowCandidate, SlowRound, search_slow
from mjx_cutting.tracing.along.slow_kinds import KINDS
from mjx_cutting.tracing.along.waves import courses
from mjx_cutting.tracing.fitting.believed_speeds import lines_as_it_turned
from mjx_cutting.tracing.fitting.edges import without_edges
from mjx_cutting.tracing.fitting.heldout import HeldOut, folds
from mjx_cutting.tracing.fitting.prediction import Prediction, grows, predictions
from mjx_cutting.tracing.fitting.problem import Problem, pose, shared_bias
from mjx_cutting.tracing.fitting.screening import screen
from mjx_cutting.tracing.guards.now_and_then import rather_now_and_then
from mjx_cutting.tracing.naming.lesser_part import rather_the_rest, refused
from mjx_cutting.tracing.naming.search import Search, search
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import Lines, band_limit, compress
from mjx_cutting.tracing.records.noise import noise_floor
from mjx_cutting.tracing.telling.verdict import final, reached
from mjx_cutting.trials.dataset import Dataset

_SWALLOWED = 0.002
_MUCH = 0.05
_TIMES = 2
_BESIDE = 2
_PROMISING = 0.2
_MUCH_OF_IT = 0.4
_LEFT = 0.12
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
class _Searches:
    """The two searches of a pass, on any records: `names` are those of the effects tried along a trial."""

    band_hz: tuple[float, float]
    names: tuple[str, ...]
    seed: int
    progress: Callable[[str], None]
    posed: Callable[[Dataset, Lines], Problem] = pose

    def steady(self, dataset: Dataset, kinds: Sequence[type[AbstractEffect]]) -> Pass:
        """The search over steady effects alone."""
        lines = lines_as_it_turned(dataset, self.band_hz)
        found = search(self.posed(dataset, lines), lines, kinds, folds(dataset, self.seed), self.progress)
        problem = found.problem
        base_model, model = (for_use(dataset, fit.model) for fit in (found.base_fit, found.final_fit))
        before = predictions(dataset, lines, problem, base_model, shared_bias(problem, found.base_fit.x))
        bias = shared_bias(problem, found.final_fit.x)
        after = predictions(dataset, lines, problem, model, bias)
        if grows(model):
            still = predictions(dataset, lines, problem, model, bias, still=True)
            found = replace(found, final=_with_growth(found.final, lines, still, after))
        return Pass(dataset, lines, found, (), base_model, model, before, after)

    def along(self, found: Pass, before: HeldOut, apart: bool = False, in_range: bool = True) -> Pass:
        """The pass with what is found along the trials beside its steady model, which leaves `before`."""
        dataset, problem, model = found.dataset, found.search.problem, found.search.final_fit.model
        ways = KINDS
        if dataset.tool.kind not in LEVEL_KINDS:
            ways = (*KINDS, entry_exit(found.lines, problem, model))
        fits = found.search.final.fits
        assert fits is not None
        trials = courses(dataset, found.lines, problem, model, found.after, fits.model)
        trials = tuple(replace(each, apart=apart) for each in trials)
        weight, tolerance = np.asarray(problem.weight), problem.tolerance
        rounds = search_slow(trials, before, weight, self.names, ways, self.progress, tolerance, in_range)
        for each in rounds:
            found = found.with_round(each)
        return replace(found, slow=rounds)


def once(
    dataset: Dataset,
    band_hz: tuple[float, float],
    kinds: Sequence[type[AbstractEffect]],
    steady: Sequence[type[AbstractEffect]],
    seed: int,
    progress: Callable[[str], None],
    posed: Callable[[Dataset, Lines], Problem] = pose,
) -> Pass:
    """Search over `steady` effects, then over those of `kinds` along a trial (call it in float64).

    `posed` makes the fitting problem of the trials.
    """
    progress("reading the lines of every trial")
    if posed is pose:
        dataset = without_edges(dataset, band_hz)
    searches = _Searches(band_hz, tuple(kind.name for kind in kinds), seed, progress, posed)
    alone = searches.steady(dataset, steady)
    first = searches.along(alone, alone.search.final, in_range=False)
    found = _beside_steady(first, steady, searches) or _freed(first, steady, searches)
    if not all(each.decision.physical for each in found.along):
        found = searches.along(alone, alone.search.final)
    moving = [kind for kind in steady if kind.by_position]
    found = _by_position(found, moving, replace(searches, posed=pose))
    why = _rather_the_rest(found)
    if why is None:
        return found
    bare = once(dataset, band_hz, kinds, (), seed, progress, posed)
    return replace(bare, search=replace(bare.search, rounds=(refused(found.search.rounds[0], why),)))


def in_ramps(found: Pass, band_hz: tuple[float, float], seed: int, progress: Callable[[str], None]) -> Pass:
    """The pass, or a better one over trials in pieces that finds an end of the sheet, where force is missing
    at the ends of the path and none was found yet."""
    looked_for = any(each.kind.name == ENDS for one in found.slow for each in one.candidates)
    if not looked_for or any(kind.name == ENDS for kind in found.kinds):
        return found
    return _by_position(found, ends_in_pieces(found.dataset), _Searches(band_hz, (), seed, progress))


def _rather_the_rest(found: Pass) -> str | None:
    """Why the steady effects found are refused, by all that is missing or because they come and go; None
    where they are not. Levels scatter from trial to trial by more than the noise within one, and there is no
    telling of what part."""
    if not found.search.effects or found.dataset.tool.kind in LEVEL_KINDS or near_floor(found):
        return None
    floor = noise_floor(found.dataset, found.lines)
    why = rather_the_rest(found.search.base, found.final, floor)
    if why is None and not found.along:
        half_hz = 0.5 * found.dataset.sensor.sample_rate_hz
        why = rather_now_and_then(
            found.before, found.after, floor, min(found.lines.band_hz[1] / half_hz, 1.0)
        )
    return why


def _freed(first: Pass, kinds: Sequence[type[AbstractEffect]], searches: _Searches) -> Pass:
    """The pass with its steady model freed of what it has swallowed, or of what hid the rest from it; `first`
    where then nothing is left of what was found along the trials."""
    taken, share = _whole(first), _swallowed(first)
    hidden = share < _SWALLOWED
    if taken is None or (hidden and _complete(first)):
        return first
    for _ in range(1 if hidden else _TIMES):
        searches.progress("once more, without what was found along the trials")
        rest = _refitted(first, _without(first.dataset, taken), kinds, share, searches)
        after, before = _on_the_whole(first.dataset, rest, taken)
        search = replace(rest.search, base=first.search.base)
        lines = replace(rest.lines, energy_n2=first.lines.energy_n2)
        again = replace(
            rest, dataset=first.dataset, lines=lines, search=search, before=first.before, after=after
        )
        found = searches.along(again, before, apart=True)
        taken = _whole(found)
        if taken is None:
            return first
    return found


def _beside_steady(first: Pass, kinds: Sequence[type[AbstractEffect]], searches: _Searches) -> Pass | None:
    """The pass that names an effect along the trials and steady ones beside it, where `first` found neither:
    what each leaves of the other's work is scatter to a test of it alone. None where it names not both, or
    much of what was missing is left."""
    doubtful = None if first.kinds or near_floor(first) else _doubtful(first)
    if doubtful is None:
        return None
    tried = first.with_round(SlowRound(first.final, (doubtful,), doubtful))
    found = _freed(tried, kinds, searches)
    names = {each.kind for each in found.along}
    if found is tried or not found.search.effects or doubtful.kind not in names:
        return None
    return found if _missing(found) < _LEFT * _missing(first) else None


def _doubtful(first: Pass) -> SlowCandidate | None:
    """What explains most along the trials, if that is much of what is missing and all that refuses it is how
    its gain scatters over them."""
    candidates = first.slow[-1].candidates if first.slow else ()
    best = next((each for each in candidates if each.decision.unsure), None)
    if best is None or best is not candidates[0]:
        return None
    explained = first.final.nrmse**2 - best.heldout.nrmse**2
    return best if explained >= _MUCH_OF_IT * _missing(first) else None


def _missing(found: Pass) -> float:
    """Share of the force's energy that is left on held-out trials beyond the noise."""
    floor = found.noise_over * noise_floor(found.dataset, found.lines)
    return max(found.final.nrmse**2 - floor**2, 0.0)


def _refitted(
    first: Pass, rest: Dataset, kinds: Sequence[type[AbstractEffect]], share: float, searches: _Searches
) -> Pass:
    """The steady pass over `rest`: all `kinds` again, unless little was swallowed and nothing else is left,
    was found or was in doubt."""
    if share >= _MUCH or first.search.effects or not _complete(first):
        return searches.steady(rest, kinds)
    alone = searches.steady(rest, ())
    return replace(alone, search=replace(alone.search, rounds=first.search.rounds))


def _complete(found: Pass) -> bool:
    """Whether nothing is left, and no steady effect was refused only for a gain that scatters over trials."""
    rounds = found.search.rounds
    in_doubt = bool(rounds) and any(each.decision.scattered for each in rounds[-1].candidates)
    return not in_doubt and near_floor(found)


def near_floor(found: Pass) -> bool:
    """Whether the pass leaves no more than noise and calculation do."""
    floor = found.noise_over * noise_floor(found.dataset, found.lines)
    return found.final.nrmse <= reached(floor, found.search.problem.tolerance)


def _by_position(first: Pass, moving: Sequence[type[AbstractEffect]], searches: _Searches) -> Pass:
    """The pass, or the better one over trials in pieces that names one of `moving`, of which the response
    changes along the path. Tried beside such are the most telling effects of the first round."""
    dataset, rounds = first.dataset, first.search.rounds
    on_path = first.search.problem.motion is not None
    if on_path or not moving or near_floor(first) or not rounds or dataset.tool.kind in LEVEL_KINDS:
        return first
    pieces = in_pieces(dataset, first.lines)
    if pieces is None:
        return first
    searches.progress("the trials in pieces")
    problem = pose(pieces, compress(pieces, searches.band_hz, orders=first.lines.orders))
    so_far, x = first.search.effects, first.search.final_fit.x
    if not any(kind.by_position for kind in so_far):
        promising = screen(problem, so_far, jnp.asarray(x), moving)
        if max(each.share for each in promising) < _PROMISING:
            return first
    telling = [each.kind for each in rounds[0].screened[:_BESIDE]]
    found = searches.steady(pieces, list(dict.fromkeys([*moving, *first.search.effects, *telling])))
    if not any(kind.by_position for kind in found.search.effects):
        return first
    search = of_whole_trials(found.search, first.search, dataset, first.lines)
    if search.final.nrmse >= first.final.nrmse:
        return first
    bias = shared_bias(search.problem, search.final_fit.x)
    after = predictions(dataset, first.lines, search.problem, found.model, bias)
    return replace(first, search=search, slow=(), model=found.model, after=after, evidence={})


def _with_growth(
    heldout: HeldOut, lines: Lines, still: Sequence[Prediction], after: Sequence[Prediction]
) -> HeldOut:
    """The error on held-out trials with what a growing effect does within each, which no line holds."""
    error = heldout.error_n2.copy()
    change = [
        np.sum(grown.residual_n**2 - mean.residual_n**2, axis=0)
        for grown, mean in zip(after, still, strict=True)
    ]
    np.add.at(error, lines.owner, np.asarray(change))
    return replace(heldout, error_n2=np.maximum(error, 0.0))


def _whole(found: Pass) -> list[Array] | None:
    """[T, 3] by trial what was found along the trials, N; None where there is none but the sheet's ends."""
    if not found.along or any(each.kind.name == ENDS for each in found.along):
        return None
    return _added([each.whole_n for each in found.along])


def _swallowed(found: Pass) -> float:
    """Share of the energy of what was found along the trials that the steady model has taken."""
    sides = ([each.whole_n for each in found.along], [each.added_n for each in found.along])
    energy, shown = (sum(float(np.sum(each**2)) for each in _added(side)) for side in sides)
    return 1.0 - shown / max(energy, 1e-300)


def _added(parts: Sequence[Sequence[Array]]) -> list[Array]:
    """[T, 3] by trial the sum of several effects, each by trial."""
    return [np.sum(of_one, axis=0) for of_one in zip(*parts, strict=True)]


def _without(dataset: Dataset, force_n: Sequence[Array]) -> Dataset:
    """The data set less [T, 3] a force in each cut trial."""
    rest, trials = iter(force_n), []
    for trial in dataset.trials:
        trials.append(replace(trial, force_n=trial.force_n - next(rest)) if trial.kind == "cut" else trial)
    return replace(dataset, trials=tuple(trials))


def _on_the_whole(
    dataset: Dataset, rest: Pass, taken_n: Sequence[Array]
) -> tuple[tuple[Prediction, ...], HeldOut]:
    """Predictions and held-out error of a model, fitted to trials less `taken_n`, on the trials whole."""
    rate, band = dataset.sensor.sample_rate_hz, rest.lines.band_hz
    after, error, energy = [], np.array(rest.search.final.error_n2), []
    for index, (each, taken) in enumerate(zip(rest.after, taken_n, strict=True)):
        measured = each.measured_n + band_limit(taken, rate, band)
        after.append(replace(each, measured_n=measured))
        error[index] += np.sum(after[-1].residual_n ** 2 - each.residual_n**2, axis=0)
        energy.append(np.sum(measured**2, axis=0))
    return tuple(after), HeldOut(np.maximum(error, 0.0), np.stack(energy), None, rest.search.final.fold)


def for_use(dataset: Dataset, model: ForceModel) -> ForceModel:
    """The model with the tool's full axial resolution and plain numbers, as others will use it."""
    shape = dataset.tool
    tool = Tool(shape.kind, shape.teeth, float(shape.diameter_m), float(shape.helix_rad))
    plain = jax.tree.map(np.asarray, (model.material, model.effects))
    return ForceModel(tool, *plain)
