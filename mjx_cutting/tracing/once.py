"""One pass over a data set: the search over steady effects, then the one over effects along a trial.

Of a sensor without a filter, what the teeth do beyond the highest line is taken off first, and again as the
teeth are found to be (`edges`).

A steady model fitted to records that hold an effect along the trial has taken part of it for its own (a layer
lowers the constants), or does not see a steady effect beneath it. So what was found is taken out of the
records, the steady search made again on the rest, and that along the trial beside its outcome; only then are
its parameters held against their physical ranges. Where much is left, trials are cut in pieces along the path
for effects whose response changes along it (`by_place`). Steady effects that take next to nothing of what is
missing are dropped in the end (`lesser_part`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.along.ends import NAME as ENDS
from mjx_cutting.tracing.along.slow_round import SlowCandidate, SlowRound
from mjx_cutting.tracing.by_place import by_place
from mjx_cutting.tracing.fitting.edges import as_found, without_edges
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.fitting.problem import Problem, pose, shared_bias
from mjx_cutting.tracing.guards.now_and_then import rather_now_and_then
from mjx_cutting.tracing.naming.lesser_part import rather_the_rest, refused
from mjx_cutting.tracing.naming.wandering import rather_wandering
from mjx_cutting.tracing.passes import Pass, Searches, missing, near_floor
from mjx_cutting.tracing.records.heard_speed import as_heard
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import Lines, band_limit
from mjx_cutting.tracing.records.part import without_force
from mjx_cutting.trials.dataset import Dataset

_SWALLOWED = 0.002
_MUCH = 0.05
_TIMES = 2
_MOST_TIMES = 8
_SETTLED = 0.9
_MUCH_OF_IT = 0.4
_LEFT = 0.12
Array = NDArray[np.floating]


def once(
    dataset: Dataset,
    band_hz: tuple[float, float],
    kinds: Sequence[type[AbstractEffect]],
    steady: Sequence[type[AbstractEffect]],
    seed: int,
    progress: Callable[[str], None],
    posed: Callable[[Dataset, Lines], Problem] = pose,
    droop_rev_s_nm: float = 0.0,
) -> Pass:
    """Search over `steady` effects, then over those of `kinds` along a trial (call it in float64).

    `posed` makes the fitting problem of the trials; `droop_rev_s_nm` is how far the motor gives way, if it is
    one that swings within the turn.
    """
    progress("reading the lines of every trial")
    if posed is pose:
        dataset = as_heard(dataset)
    measured = dataset
    if posed is pose:
        dataset = without_edges(measured, band_hz)
    searches = Searches(band_hz, tuple(kind.name for kind in kinds), seed, progress, posed, droop_rev_s_nm)
    alone = searches.steady(dataset, steady)
    if dataset is not measured and (clearer := _less_edges_as_found(measured, alone)) is not None:
        progress("once more, without the edges of the teeth as found")
        alone = searches.steady(clearer, steady)
    first = searches.along(alone, alone.search.final, in_range=False)
    found = _beside_steady(first, steady, searches) or _freed(first, steady, searches)
    if not all(each.decision.physical for each in found.along):
        found = searches.along(alone, alone.search.final)
    moving = [kind for kind in steady if kind.by_position]
    found = by_place(found, moving, replace(searches, posed=pose))
    why = _why_refused(found, steady)
    if why is None:
        return found
    bare = once(dataset, band_hz, kinds, (), seed, progress, posed, droop_rev_s_nm)
    return replace(bare, search=replace(bare.search, rounds=(refused(found.search.rounds[0], why),)))


def _less_edges_as_found(measured: Dataset, alone: Pass) -> Dataset | None:
    """The trials less what their teeth, unlike each other, do beyond the lines; None where that is no more
    than was taken off before."""
    found = alone.search
    if not found.effects:
        return None
    bias = shared_bias(found.problem, found.final_fit.x)
    return as_found(measured, alone.lines, found.problem, found.final_fit.model, bias)


def _why_refused(found: Pass, tried: Sequence[type[AbstractEffect]]) -> str | None:
    """Why the steady effects found, of those `tried`, are refused: by all that is missing, because they come
    and go, or of levels because the force wanders as much within the trials; None where they are not."""
    result = found.search
    if not result.effects or near_floor(found):
        return None
    if found.dataset.tool.kind in LEVEL_KINDS:
        problem = result.problem
        starts = sum(len(kind.starts(problem.tool)) for kind in tried)
        known = np.asarray(result.base_fit.x), np.asarray(result.final_fit.x)
        return rather_wandering(problem, result.effects, *known, found.after, starts)
    why = rather_the_rest(result.base, found.final, found.floor_nrmse)
    if why is None and not found.along:
        passed = min(2.0 * found.lines.band_hz[1] / found.dataset.sensor.sample_rate_hz, 1.0)
        why = rather_now_and_then(found.before, found.after, found.floor_nrmse, passed)
    return why


def _freed(first: Pass, kinds: Sequence[type[AbstractEffect]], searches: Searches) -> Pass:
    """The pass with its steady model freed of what it has swallowed, or of what hid the rest from it; `first`
    where then nothing is left of what was found along the trials."""
    taken, share = _whole(first), _swallowed(first)
    hidden = share < _SWALLOWED
    if taken is None or (hidden and _complete(first)):
        return first
    found = first
    for made in range(1 if hidden else _MOST_TIMES):
        error = found.final.nrmse
        searches.progress("once more, without what was found along the trials")
        rest = _refitted(first, without_force(first.dataset, taken), kinds, share, searches)
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
        if made + 1 >= _TIMES and found.final.nrmse > _SETTLED * error:
            break
    # what is found anew beside the freed model may be part of it only: of several layers, one
    return found if _SETTLED * found.final.nrmse < first.final.nrmse else first


def _beside_steady(first: Pass, kinds: Sequence[type[AbstractEffect]], searches: Searches) -> Pass | None:
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
    return found if missing(found) < _LEFT * missing(first) else None


def _doubtful(first: Pass) -> SlowCandidate | None:
    """What explains most along the trials, if that is much of what is missing and all that refuses it is how
    its gain scatters over them."""
    candidates = first.slow[-1].candidates if first.slow else ()
    best = next((each for each in candidates if each.decision.unsure), None)
    if best is None or best is not candidates[0]:
        return None
    explained = first.final.nrmse**2 - best.heldout.nrmse**2
    return best if explained >= _MUCH_OF_IT * missing(first) else None


def _refitted(
    first: Pass, rest: Dataset, kinds: Sequence[type[AbstractEffect]], share: float, searches: Searches
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
