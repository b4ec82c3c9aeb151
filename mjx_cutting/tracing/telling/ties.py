"""Which other effect explains as much as the one named, and the further trial that would tell them apart."""

from __future__ import annotations

from collections.abc import Container
from typing import Any

import numpy as np

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.fitting.problem import TOLERANCE, Problem, shared_bias
from mjx_cutting.tracing.naming.bends import follows_any
from mjx_cutting.tracing.naming.candidate import Candidate, Round
from mjx_cutting.tracing.naming.chance import surely
from mjx_cutting.tracing.naming.search import Search
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import Lines
from mjx_cutting.tracing.telling.separation import separations
from mjx_cutting.trials.dataset import Dataset

TIED = 2.0
_THE_SAME = 0.6
_TELLING = 5.0
_SMALL_PART = 0.25
_OF_NOISE = 0.06
_SEVERAL = 4.0
_WIDER = "trials over a wider range of speed and feed"


def tie(
    each: Round,
    named: Container[type[AbstractEffect]],
    dataset: Dataset,
    lines: Lines,
    found: Search,
    floor: float,
) -> dict[str, Any] | None:
    """The accepted effect and another, not `named` itself, that explains the same part of the force not worse
    beyond two standard errors, nor by what tells two apart where noise, `floor` of the force, is all that one
    leaves, and passed every test, or all but that which would tell the two apart. Or one that passed every
    test and is worse by a small part of what neither explains beyond the noise: whatever that is may favour
    either, and be what a guard refused the other for.

    Beside all that was found later too, where they were tried so: what else was missing made two look alike
    that are not.
    """
    assert each.accepted is not None
    best = each.accepted.heldout
    unexplained = float(best.error_n2.sum() - floor**2 * best.energy_n2.sum())
    for other in each.candidates:
        told = other.decision
        if other.kind in named or not (told.accepted or told.untold or told.guarded):
            continue
        if follows_any(dataset.tool.kind, each.accepted, other):
            continue
        second, first = (each.error_n2.sum(axis=1) for each in (other.heldout, best))
        gap = second - first
        close = max(surely(gap), surely(gap / np.maximum(second + first, 1e-300))) <= TIED
        close = close and not (told.guarded or _noise_tells(each.accepted, other, dataset, floor))
        if close or float(gap.sum()) < _SMALL_PART * unexplained:
            first = np.ravel(best.error_n2 - each.before.error_n2)
            second = np.ravel(other.heldout.error_n2 - each.before.error_n2)
            cosine = float(first @ second / max(np.linalg.norm(first) * np.linalg.norm(second), 1e-300))
            if cosine < _THE_SAME:
                continue
            if each.again is not None:
                return tie(each.again, named, dataset, lines, found, floor)
            return {
                "names": [each.accepted.kind.name, other.kind.name],
                "cosine": cosine,
                "separating_trial": _settles(each.accepted, other, dataset, lines, found.problem),
            }
    return None


def _noise_tells(best: Candidate, other: Candidate, dataset: Dataset, floor: float) -> bool:
    """Whether the better of two leaves no more than noise, `floor` of the force, and the other, of no fewer
    unknowns, several times as much beyond that.

    Their gap over trials may scatter all the same: most of it is in the few trials that show the effect.
    Not of levels, whose noise within a trial is not all of theirs.
    """
    if dataset.tool.kind in LEVEL_KINDS or other.told < best.told:
        return False
    force_n2 = float(best.heldout.energy_n2.sum())
    noise = floor**2 * force_n2
    beyond = float(best.heldout.error_n2.sum()) - noise
    gap = float(other.heldout.error_n2.sum()) - noise - beyond
    return beyond <= _OF_NOISE * noise and gap >= max(_SEVERAL * _OF_NOISE * noise, TOLERANCE**2 * force_n2)


def _settles(first: Candidate, second: Candidate, dataset: Dataset, lines: Lines, problem: Problem) -> str:
    """The cheapest further trial that tells two candidates apart, in words, with what it would bring."""
    known = first.kind.confused_with.get(second.kind.name) or second.kind.confused_with.get(first.kind.name)
    if dataset.tool.kind in LEVEL_KINDS:
        return known or _WIDER
    models = first.fit.model, second.fit.model
    bias = shared_bias(problem, first.fit.x), shared_bias(problem, second.fit.x)
    best = separations(dataset, lines, problem, *models, bias)[0]
    if best.sigma < _TELLING:
        return f"{known or _WIDER}; no repeat of a trial at another feed, depth or speed would do it"
    also = f"; {known}" if known else ""
    return f"{best.trial}: the two predictions of it lie {best.sigma:.0f} standard deviations apart{also}"
