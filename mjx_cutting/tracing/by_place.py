"""A pass over trials in pieces along their path (`pieces`), for effects whose response changes along it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import jax.numpy as jnp

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.along.ends import NAME as ENDS
from mjx_cutting.tracing.along.pieces import in_pieces, of_whole_trials
from mjx_cutting.tracing.along.ramps import changes_at_an_end, ends_in_pieces
from mjx_cutting.tracing.fitting.prediction import predictions
from mjx_cutting.tracing.fitting.problem import pose, shared_bias
from mjx_cutting.tracing.fitting.screening import screen
from mjx_cutting.tracing.passes import Pass, Searches, for_use, near_floor
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import compress

_PROMISING = 0.2
_BESIDE = 2


def by_place(first: Pass, moving: Sequence[type[AbstractEffect]], searches: Searches) -> Pass:
    """The pass, or the better one over trials in pieces that names one of `moving`, of which the response
    changes along the path. Tried beside such are the most telling effects of the first round."""
    found = _over_pieces(first, moving, searches)
    return first if found is None else _better_on_trials(first, found, anew=False)


def in_ramps(found: Pass, band_hz: tuple[float, float], seed: int, progress: Callable[[str], None]) -> Pass:
    """The pass, or a better one over trials in pieces that finds an end of the sheet, where force is missing
    at the ends of the path and none was found yet."""
    looked_for = any(each.kind.name == ENDS for one in found.slow for each in one.candidates)
    if (
        not looked_for
        or any(kind.name == ENDS for kind in found.kinds)
        or not changes_at_an_end(found.dataset)
    ):
        return found
    searches = Searches(band_hz, (), seed, progress)
    over_pieces = _over_pieces(found, ends_in_pieces(found.dataset), searches)
    if over_pieces is None:
        return found
    progress("the ends of the sheet on the trials")
    better = _better_on_trials(_every_order(found, band_hz), over_pieces, anew=True)
    return better if any(kind.name == ENDS for kind in better.kinds) else found


def _over_pieces(first: Pass, moving: Sequence[type[AbstractEffect]], searches: Searches) -> Pass | None:
    """The pass over trials in pieces; None where there is no call for one, or it names none of `moving`."""
    dataset, rounds = first.dataset, first.search.rounds
    on_path = first.search.problem.motion is not None
    if on_path or not moving or near_floor(first) or not rounds or dataset.tool.kind in LEVEL_KINDS:
        return None
    pieces = in_pieces(dataset, first.lines)
    if pieces is None:
        return None
    searches.progress("the trials in pieces")
    problem = pose(pieces, compress(pieces, searches.band_hz, like=first.lines))
    so_far, x = first.search.effects, first.search.final_fit.x
    if not any(kind.by_position for kind in so_far):
        promising = screen(problem, so_far, jnp.asarray(x), moving)
        if max(each.share for each in promising) < _PROMISING:
            return None
    telling = [each.kind for each in rounds[0].screened[:_BESIDE]]
    found = searches.steady(pieces, list(dict.fromkeys([*moving, *first.search.effects, *telling])))
    return found if any(kind.by_position for kind in found.search.effects) else None


def _better_on_trials(first: Pass, found: Pass, anew: bool) -> Pass:
    """What was `found` over pieces as a pass over the trials, fitted `anew` to them or as it is; `first`
    where that leaves more."""
    dataset, lines = first.dataset, first.lines
    search = of_whole_trials(found.search, found.lines, first.search, dataset, lines, anew)
    if search.final.nrmse >= first.final.nrmse:
        return first
    model = for_use(dataset, search.final_fit.model)
    bias = shared_bias(search.problem, search.final_fit.x)
    after = predictions(dataset, lines, search.problem, model, bias)
    return replace(first, search=search, slow=(), model=model, after=after, evidence={})


def _every_order(found: Pass, band_hz: tuple[float, float]) -> Pass:
    """The pass with every line of the band: of a cut that changes all along, the higher ones are smeared and
    hardly stand out of a whole record."""
    lines = compress(found.dataset, band_hz, found.lines.speed_rev_s, every=True)
    search = replace(found.search, problem=pose(found.dataset, lines))
    return replace(found, lines=lines, search=search)
