"""Search over effects that change along a trial, after the steady ones: same tests, same held-out trials.

A named effect must also do most of what an unnamed one could: force that varies freely with position (hats
over the path) is fitted beside it, and where that does better by a sixth, the effect is not the cause.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.along.kind import Kind, as_values
from mjx_cutting.tracing.along.layers import borders_on, columns_of, together
from mjx_cutting.tracing.along.shapes import (
    Sums,
    error_change,
    phases,
    solve,
    solve_in_phase,
    sums,
)
from mjx_cutting.tracing.along.slow_kinds import KINDS
from mjx_cutting.tracing.along.surety import intervals, reach_of_the_model, unsure_force
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.naming.decision import (
    TOLERANCE,
    Decision,
    chance_over_trials,
    decide,
)
from mjx_cutting.tracing.records.course import Course

MOST_SLOW = 6
_MOST_LAYERS = 3
_HATS = 24
_HARDLY = 1e-3
FEWEST_REACHED = 4
_SHARE_OF_FREE = 0.85
_ZOOMS = (1.0, 6.0, 36.0, 216.0)
_IN_POSITION = ("material_periodicity", "layered_material", "entry_exit", "hysteresis")
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class SlowCandidate:
    """A slow effect tried: as fitted, its held-out error, the decision; what it adds to each trial, N, beside
    a steady model fitted without it (`added_n`), and by itself (`whole_n`); `short_of_free` where all that
    refuses it is that force free in position does better; its `shape` [d]; the share by which its strength
    may be off as the steady model is (`unsure`)."""

    kind: type[AbstractEffect]
    effect: AbstractEffect
    heldout: HeldOut
    decision: Decision
    added_n: tuple[Array, ...]
    whole_n: tuple[Array, ...] = ()
    short_of_free: bool = False
    shape: Array = field(default_factory=lambda: np.zeros(0))
    unsure: float = 0.0


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
            tried.append(_try(kind, trials, before, test, _found(rounds, kind)))
        tried.sort(key=lambda each: each.heldout.nrmse)
        accepted = next((each for each in tried if each.decision.accepted), None)
        if accepted is None:
            short = [each.kind for each in tried if each.short_of_free]
            layers = [kind for kind in open_ if kind.several and kind.effect in short]
            stack = [
                each
                for kind in layers[:1]
                for each in _stack(kind, trials, before, test, _found(rounds, kind))
            ]
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
    for kind in kinds:
        if len(_found(rounds, kind)) > 1:
            rounds = _fitted_together(rounds, kind, trials, before, weight)
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


def _found(rounds: Sequence[SlowRound], kind: Kind) -> list[Array]:
    """Shapes of what was accepted of a kind that may be there several times; none where each is at a phase of
    its own, and so beside the others."""
    if not kind.several or kind.own_phase:
        return []
    accepted = (each.accepted for each in rounds)
    return [each.shape for each in accepted if each is not None and each.kind is kind.effect]


def _without(trials: Sequence[Course], found: SlowCandidate) -> list[Course]:
    """The trials less what was found."""
    return [
        replace(each, left_n=each.left_n - added) for each, added in zip(trials, found.added_n, strict=True)
    ]


def _stack(
    kind: Kind, trials: Sequence[Course], before: HeldOut, test: _Test, beside: list[Array]
) -> list[SlowCandidate]:
    """Several of a kind that together do all that force free in position could, though the first alone does
    not: a sheet of several layers. Empty where they do not: steps come near to anything, if not quite."""
    found: list[SlowCandidate] = []
    explained = 0.0
    while len(found) < _MOST_LAYERS:
        others = [*beside, *(each.shape for each in found)]
        one = _try(kind, trials, before, replace(test, free=0.0), others)
        if not one.decision.accepted:
            return []
        found.append(one)
        explained += _explained(before, one.heldout, test.weight)
        if explained >= test.free:
            return found
        before, trials = one.heldout, _without(trials, one)
    return []


def _fitted_together(
    rounds: Sequence[SlowRound], kind: Kind, trials: Sequence[Course], before: HeldOut, weight: Array
) -> list[SlowRound]:
    """The rounds with the strengths of all that was accepted of a kind fitted at once, to what `trials` leave
    when all that was found is taken out."""
    accepted = [
        each.accepted for each in rounds if each.accepted is not None and each.accepted.kind is kind.effect
    ]
    trials = [
        replace(course, left_n=course.left_n + sum(added))
        for course, *added in zip(trials, *(each.added_n for each in accepted), strict=True)
    ]
    found = together(kind, trials, [each.shape for each in accepted])
    uses = [(before.fold != fold).astype(float) for fold in range(int(before.fold.max()) + 1)]
    _, whole, _ = solve(found, np.ones(len(trials)), weight)
    by_fold = [solve(found, use, weight)[1] for use in uses]
    strength, settled = kind.effect.strength, {}
    for i, each in enumerate(accepted):
        effect = kind.build(each.shape, whole[i : i + 1])
        values = [as_values(kind.build(each.shape, c[i : i + 1])) for c in by_fold]
        told = {strength: intervals(kind, effect, values, each.unsure)[strength]}
        columns = [kind.columns(course, each.shape) * whole[i] for course in trials]
        settled[id(each)] = replace(
            each,
            effect=effect,
            decision=replace(each.decision, parameters=each.decision.parameters | told),
            added_n=tuple(c.own(one)[..., 0] for c, one in zip(trials, columns, strict=True)),
            whole_n=tuple(one[..., 0] for one in columns),
        )
    return [
        replace(
            each,
            candidates=tuple(settled.get(id(one), one) for one in each.candidates),
            accepted=settled.get(id(each.accepted), each.accepted),
        )
        for each in rounds
    ]


def _explained(before: HeldOut, after: HeldOut, weight: Array) -> float:
    """Fall of the weighted squared error on held-out trials."""
    return float(np.sum((before.error_n2 - after.error_n2) * weight**2))


def _try(
    kind: Kind, trials: Sequence[Course], before: HeldOut, test: _Test, beside: Sequence[Array] = ()
) -> SlowCandidate:
    """The best of a kind, and whether it is accepted; those found `beside` it [d] are fitted anew with it."""
    weight, shapes = test.weight, kind.grid(trials)
    everyone = np.ones(len(trials))
    found, grid = kind.sums_of(trials, shapes), shapes
    for zoom in _ZOOMS:
        if kind.refine is None:
            break
        near = kind.refine(grid, shapes[solve(found, everyone, weight, kind.shared)[0]], zoom)
        close = kind.sums_of(trials, near)
        shapes = np.concatenate([shapes, near])
        found = Sums(
            np.concatenate([found.square, close.square], axis=1),
            np.concatenate([found.product, close.product], axis=1),
        )
    fits = _Fits(kind, trials, found, shapes, weight, tuple(beside))
    best, c = fits.to(everyone)
    effect = kind.build(shapes[best], c)
    error = np.zeros_like(before.error_n2)
    by_fold = []
    for fold in range(int(before.fold.max()) + 1):
        shape, own = fits.to((before.fold != fold).astype(float))
        held = before.fold == fold
        error[held] = (before.error_n2 + fits.error_change(shape, own))[held]
        by_fold.append(as_values(kind.build(shapes[shape], own)))
    after = HeldOut(np.maximum(error, 0.0), before.energy_n2, None, before.fold)
    reached = _reached(kind, trials, shapes[best])
    p = chance_over_trials(before.only(reached), after.only(reached), test.tries)
    reach = reach_of_the_model(kind, trials, shapes[best])
    error_of_it = reach * TOLERANCE
    accounted = float(np.sqrt(max(before.nrmse**2 - after.nrmse**2, error_of_it**2, 1e-24)))
    unsure = error_of_it / accounted
    parameters = intervals(kind, effect, by_fold, unsure)
    off = reach * test.tolerance
    decision = decide(kind.effect, before, after, p, parameters, tolerance=off, in_range=test.in_range)
    if decision.accepted:
        # that it is there does not hang on how large the force is; how large a share of it, does
        unsure += unsure_force(kind, trials, shapes[best], c[: len(c) - len(beside)], weight)
        parameters = intervals(kind, effect, by_fold, unsure)
        decision = replace(decision, parameters=parameters)
    explained = _explained(before, after, weight)
    short = decision.accepted and kind.name in _IN_POSITION and explained < _SHARE_OF_FREE * test.free
    if short:
        ratio = test.free / max(explained, 1e-300)
        why = f"force that varies freely with position explains {ratio:.1f} times as much"
        decision = replace(decision, accepted=False, reasons=(why,))
    rather = None if beside and borders_on(shapes[best], beside) else kind.rather
    if decision.accepted and rather is not None and (why := rather(trials, effect)):
        decision = replace(decision, accepted=False, reasons=(why,))
    added, whole = [], []
    for course, one in zip(trials, fits.in_each(best, c), strict=True):
        columns = fits.columns(course, best)
        added.append(course.own(columns) @ one)
        whole.append(columns @ one)
    return SlowCandidate(
        kind.effect, effect, after, decision, tuple(added), tuple(whole), short, shapes[best], unsure
    )


def _reached(kind: Kind, trials: Sequence[Course], shape: Array) -> NDArray[np.bool_]:
    """[R] the trials that a shape [d] changes at all: those that end before its place, or begin beyond it,
    say nothing for it or against. All, where few do."""
    changed = [np.mean(kind.columns(course, shape) ** 2) for course in trials]
    share = np.asarray(changed) / [np.mean(course.force(1.0) ** 2) for course in trials]
    reached = share > _HARDLY * share.max()
    return reached if reached.sum() >= FEWEST_REACHED else np.ones(len(trials), bool)


@dataclass(frozen=True, eq=False)
class _Fits:
    """Fits of one of a kind: the `found` statistics at `shapes` [P, d], and those `beside` it fitted anew."""

    kind: Kind
    trials: Sequence[Course]
    found: Sums
    shapes: Array
    weight: Array
    beside: tuple[Array, ...]

    def to(self, use: Array) -> tuple[int, Array]:
        """Best shape and its coefficients [k], with those of the others behind them, over the trials used."""
        if self.kind.own_phase:
            return solve_in_phase(self.found, use, self.weight)
        best, c, _ = solve(self.found, use, self.weight, self.kind.shared)
        return best, solve(self._at(best)[0], use, self.weight)[1] if self.beside else c

    def error_change(self, shape: int, c: Array) -> Array:
        """[R, 3] change of each trial's squared error, N^2."""
        return error_change(*self._at(shape), self.in_each(shape, c))

    def in_each(self, shape: int, c: Array) -> Array:
        """[R, k] coefficients in every trial, its own phase fitted on it where the effect has one."""
        if self.kind.own_phase:
            return phases(self.found, shape, c, self.weight) @ c
        return np.tile(c, (len(self.trials), 1))

    def columns(self, course: Course, shape: int) -> Array:
        """[T, 3, k] what each coefficient adds to a trial."""
        return columns_of(self.kind, course, (self.shapes[shape], *self.beside))

    def _at(self, shape: int) -> tuple[Sums, int]:
        """Statistics that hold a shape with those beside it, and its place in them."""
        if not self.beside:
            return self.found, shape
        return together(self.kind, self.trials, (self.shapes[shape], *self.beside)), 0


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
