"""Search over effects that change along a trial, after the steady ones: same tests, same held-out trials.

A named effect must also do most of what an unnamed one could: force that varies freely with position (hats
over the path) is fitted beside it, and where that does better by a sixth, the effect is not the cause.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.along.kind import Kind, as_values
from mjx_cutting.tracing.along.shapes import (
    Sums,
    error_change,
    phases,
    solve,
    solve_in_phase,
    sums,
)
from mjx_cutting.tracing.along.slow_kinds import KINDS
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.naming.decision import (
    TOLERANCE,
    Decision,
    Interval,
    chance_over_trials,
    decide,
    half_width,
    interval,
)
from mjx_cutting.tracing.records.course import Course

MOST_SLOW = 4
_HATS = 24
_SHARE_OF_FREE = 0.85
_MOST_UNSURE = 2.0
_ZOOMS = (1.0, 6.0, 36.0, 216.0)
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class SlowCandidate:
    """A slow effect tried: as fitted, its held-out error, the decision; what it adds to each trial, N, beside
    a steady model fitted without it (`added_n`), and by itself (`whole_n`); `short_of_free` where all that
    refuses it is that force free in position does better."""

    kind: type[AbstractEffect]
    effect: AbstractEffect
    heldout: HeldOut
    decision: Decision
    added_n: tuple[Array, ...]
    whole_n: tuple[Array, ...] = ()
    short_of_free: bool = False


@dataclass(frozen=True, eq=False)
class SlowRound:
    """One round: error before, the candidates in order of held-out error, and the one accepted, if any."""

    before: HeldOut
    candidates: tuple[SlowCandidate, ...]
    accepted: SlowCandidate | None

    @property
    def runner_up(self) -> SlowCandidate | None:
        """The best candidate that was not accepted."""
        return next((each for each in self.candidates if each is not self.accepted), None)


def search_slow(
    trials: Sequence[Course],
    before: HeldOut,
    weight: Array,
    names: Sequence[str] | None = None,
    kinds: Sequence[Kind] = KINDS,
    progress: Callable[[str], None] = lambda text: None,
    tolerance: float = TOLERANCE,
    in_range: bool = True,
) -> tuple[SlowRound, ...]:
    """Slow effects accepted one after another, beside a steady model that leaves `before` on held-out trials.

    Arguments:
        trials: courses of the cut trials.
        before: held-out error of the steady model, with its folds.
        weight: [3] 1 / standard deviation of each axis.
        names: effects to try of `kinds`; default all.
        kinds: how each is looked for.
        tolerance: share of the force that the steady model's own calculation may be off.
        in_range: whether parameters must lie in their physical ranges. A share of the force does not until
            the steady model is freed of what it has taken for its own.
    """
    open_ = [
        kind
        for kind in kinds
        if (names is None or kind.name in names) and kind.testable(trials) and len(kind.grid(trials))
    ]
    rounds: list[SlowRound] = []
    while open_ and len(rounds) < MOST_SLOW:
        free = _free_in_position(trials, before, weight)
        test = _Test(weight, free, len(open_), tolerance, in_range)
        tried = []
        for kind in open_:
            progress(f"along the trial: {kind.name}")
            tried.append(_try(kind, trials, before, test))
        tried.sort(key=lambda each: each.heldout.nrmse)
        accepted = next((each for each in tried if each.decision.accepted), None)
        if accepted is None:
            short = [each.kind for each in tried if each.short_of_free]
            layers = [kind for kind in open_ if kind.several and kind.effect in short]
            stack = [each for kind in layers[:1] for each in _stack(kind, trials, before, test)]
            for each in stack:
                others = (other for other in tried if other.kind is not each.kind)
                rounds.append(SlowRound(before, (each, *others), each))
                before, trials = each.heldout, _without(trials, each)
            if stack:
                continue
        rounds.append(SlowRound(before, tuple(tried), accepted))
        if accepted is None:
            break
        before, trials = accepted.heldout, _without(trials, accepted)
        open_ = [kind for kind in open_ if kind.several or kind.effect is not accepted.kind]
    return tuple(rounds)


@dataclass(frozen=True, eq=False)
class _Test:
    """What every effect of a round is held to: `weight` [3] of the axes; the fall of the error that force
    `free` in position brings; how many were tried (`tries`); `tolerance` and `in_range` of `search_slow`."""

    weight: Array
    free: float
    tries: int
    tolerance: float
    in_range: bool


def _without(trials: Sequence[Course], found: SlowCandidate) -> list[Course]:
    """The trials less what was found."""
    return [
        replace(each, left_n=each.left_n - added) for each, added in zip(trials, found.added_n, strict=True)
    ]


def _stack(kind: Kind, trials: Sequence[Course], before: HeldOut, test: _Test) -> list[SlowCandidate]:
    """Several of a kind that together do all that force free in position could, though the first alone does
    not: a sheet of several layers. Empty where they do not: steps come near to anything, if not quite."""
    found: list[SlowCandidate] = []
    explained = 0.0
    while len(found) < MOST_SLOW - 1:
        one = _try(kind, trials, before, replace(test, free=0.0))
        if not one.decision.accepted:
            return []
        found.append(one)
        explained += _explained(before, one.heldout, test.weight)
        if explained >= test.free:
            return found
        before, trials = one.heldout, _without(trials, one)
    return []


def _explained(before: HeldOut, after: HeldOut, weight: Array) -> float:
    """Fall of the weighted squared error on held-out trials."""
    return float(np.sum((before.error_n2 - after.error_n2) * weight**2))


def _try(kind: Kind, trials: Sequence[Course], before: HeldOut, test: _Test) -> SlowCandidate:
    weight, shapes = test.weight, kind.grid(trials)
    everyone = np.ones(len(trials))
    found, grid = kind.sums_of(trials, shapes), shapes
    for zoom in _ZOOMS:
        if kind.refine is None:
            break
        near = kind.refine(grid, shapes[solve(found, everyone, weight)[0]], zoom)
        close = kind.sums_of(trials, near)
        shapes = np.concatenate([shapes, near])
        found = Sums(
            np.concatenate([found.square, close.square], axis=1),
            np.concatenate([found.product, close.product], axis=1),
        )
    best, c = _fit(kind, found, everyone, weight)
    effect = kind.build(shapes[best], c)
    error = np.zeros_like(before.error_n2)
    by_fold = []
    for fold in range(int(before.fold.max()) + 1):
        shape, own = _fit(kind, found, (before.fold != fold).astype(float), weight)
        held = before.fold == fold
        change = error_change(found, shape, _in_each(kind, found, shape, own, weight))
        error[held] = (before.error_n2 + change)[held]
        by_fold.append(as_values(kind.build(shapes[shape], own)))
    after = HeldOut(np.maximum(error, 0.0), before.energy_n2, None, before.fold)
    p = chance_over_trials(before, after, test.tries)
    reach = _reach_of_the_model(kind, trials, shapes[best])
    error_of_it = reach * TOLERANCE
    accounted = float(np.sqrt(max(before.nrmse**2 - after.nrmse**2, error_of_it**2, 1e-24)))
    parameters = _intervals(kind, effect, by_fold, error_of_it / accounted)
    off = reach * test.tolerance
    decision = decide(kind.effect, before, after, p, parameters, tolerance=off, in_range=test.in_range)
    if decision.accepted:
        # that it is there does not hang on how large the force is; how large a share of it, does
        more = _unsure_force(kind, trials, shapes[best], c, weight)
        parameters = _intervals(kind, effect, by_fold, error_of_it / accounted + more)
        decision = replace(decision, parameters=parameters)
    explained = _explained(before, after, weight)
    short = decision.accepted and kind.name in _IN_POSITION and explained < _SHARE_OF_FREE * test.free
    if short:
        ratio = test.free / max(explained, 1e-300)
        why = f"force that varies freely with position explains {ratio:.1f} times as much"
        decision = replace(decision, accepted=False, reasons=(why,))
    if decision.accepted and kind.rather is not None and (why := kind.rather(trials, effect)):
        decision = replace(decision, accepted=False, reasons=(why,))
    own_c = _in_each(kind, found, best, c, weight)
    added, whole = [], []
    for course, one in zip(trials, own_c, strict=True):
        columns = kind.columns(course, shapes[best])
        added.append(course.own(columns) @ one)
        whole.append(columns @ one)
    return SlowCandidate(kind.effect, effect, after, decision, tuple(added), tuple(whole), short)


def _fit(kind: Kind, found: Sums, use: Array, weight: Array) -> tuple[int, Array]:
    """Best shape and coefficients [k] over the trials used."""
    if kind.own_phase:
        return solve_in_phase(found, use, weight)
    best, c, _ = solve(found, use, weight)
    return best, c


def _in_each(kind: Kind, found: Sums, shape: int, c: Array, weight: Array) -> Array:
    """[R, k] coefficients in every trial, its own phase fitted on it where the effect has one."""
    if kind.own_phase:
        return phases(found, shape, c, weight) @ c
    return np.tile(c, (len(found.product), 1))


_IN_POSITION = ("material_periodicity", "layered_material", "entry_exit", "hysteresis")


def _reach_of_the_model(kind: Kind, trials: Sequence[Course], shape: Array) -> float:
    """How much of its own error a model of the cut can put where the effect acts, 0 to 1.

    What starts each trial at a phase of its own, whatever the spindle does, stands beside the lines of the
    cut: there, a wrong calculation has its share of what is calculated. All other effects act on just that.
    """
    if not kind.own_phase:
        return 1.0
    there = whole = 0.0
    for course in trials:
        columns = kind.columns(course, shape)
        columns = columns.reshape(-1, columns.shape[-1])
        force = (course.chip_n + course.edge_n).ravel()
        there += float(np.sum((columns @ np.linalg.lstsq(columns, force, rcond=None)[0]) ** 2))
        whole += float(np.sum(force**2))
    return float(np.sqrt(there / max(whole, 1e-300)))


def _intervals(
    kind: Kind, effect: AbstractEffect, by_fold: list[dict[str, Array]], unsure: float
) -> dict[str, Interval]:
    """Intervals by name; by the model's own error the strength may be off by the share `unsure` of it."""
    whole, found = as_values(effect), {}
    for name in (each for each in kind.effect.parameters if each in whole):
        error = unsure * np.abs(whole[name]) if name == kind.effect.strength else 0.0
        by_name = np.stack([each[name] for each in by_fold])
        declared = kind.effect.parameters[name]
        if name in kind.untold and not np.any(np.append(by_name, whole[name]) != declared.identity):
            found[name] = Interval(float(whole[name]), declared.low, declared.high, declared.unit)
            continue
        found[name] = interval(kind.effect, name, whole[name], by_name, model_error=error, on_grid=True)
    return found


def _unsure_force(kind: Kind, trials: Sequence[Course], shape: Array, c: Array, weight: Array) -> float:
    """Half-width of the interval of the force that an effect is a share of, over that force: how far the
    steady models that were fitted without a fold differ."""
    found = []
    of_all = [(kind.columns(course, shape) @ c) * weight for course in trials]
    for fold in range(len(trials[0].chip_by_fold)):
        common = energy = 0.0
        for course, whole in zip(trials, of_all, strict=True):
            other = (kind.columns(course.without(fold), shape) @ c) * weight
            common += float(np.sum(whole * other))
            energy += float(np.sum(other**2))
        found.append(common / max(energy, 1e-300))
    half = half_width(np.asarray(found)[:, None]) if found else np.zeros(1)
    return min(float(half[0]), _MOST_UNSURE)


def _free_in_position(trials: Sequence[Course], before: HeldOut, weight: Array) -> float:
    """Fall of the weighted squared error on held-out trials that force free to vary with position brings."""
    low = min(float(each.position_m.min()) for each in trials)
    high = max(float(each.position_m.max()) for each in trials)
    knots = np.linspace(low, high, _HATS)
    width = max(knots[1] - knots[0], 1e-9)

    def hats(course: Course, shape: Array) -> Array:
        share = np.clip(1.0 - np.abs(course.position_m[:, None] - knots) / width, 0.0, 1.0)
        return (course.chip_n + course.edge_n)[..., None] * share[:, None, :]

    found = sums(hats, trials, np.zeros((1, 1)))
    fall = 0.0
    for fold in range(int(before.fold.max()) + 1):
        _, c, _ = solve(found, (before.fold != fold).astype(float), weight)
        held = before.fold == fold
        fall -= float(np.sum(error_change(found, 0, c)[held] * weight**2))
    return max(fall, 0.0)
