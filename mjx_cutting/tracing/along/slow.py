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
from mjx_cutting.tracing.along.layers import borders_on, columns_of, settled, together
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
    Interval,
    chance_over_trials,
    decide,
)
from mjx_cutting.tracing.records.course import Course

MOST_SLOW = 6
_MOST_LAYERS = 3
_CLOSER = 0.9
_MORE = 0.2
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
    left = trials
    while open_ and len(rounds) < MOST_SLOW:
        free = _free_in_position(left, before, weight)
        test = _Test(weight, free, len(open_), tolerance, in_range)
        tried = []
        for kind in open_:
            progress(f"along the trial: {kind.name}")
            tried.append(_try(kind, left, before, test, _found(rounds, kind)))
        tried.sort(key=lambda each: each.heldout.nrmse)
        accepted = next((each for each in tried if each.decision.accepted), None)
        layers = next((kind for kind in open_ if kind.stack is not None), None)
        least = _least_of_layers(layers, tried, accepted, before, test)
        stack: list[SlowCandidate] = []
        if layers is not None and least is not None:
            stack = _stack(layers, left, before, test, _found(rounds, layers), least)
        if stack:
            others = tuple(each for each in tried if each.kind is not stack[0].kind)
            for each in stack:
                rounds.append(SlowRound(before, (each, *others), each))
                before = each.heldout
        else:
            rounds.append(SlowRound(before, tuple(tried), accepted))
            if accepted is None:
                break
            open_ = [kind for kind in open_ if kind.several or kind.effect is not accepted.kind]
        if layers is not None:
            rounds = _with_together(rounds, layers, _less(trials, rounds), weight)
        left = _less(trials, rounds)
        before = rounds[-1].accepted.heldout if rounds[-1].accepted is not None else before
    for kind in kinds:
        rounds = _with_together(rounds, kind, left, weight)
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


def _less(trials: Sequence[Course], rounds: Sequence[SlowRound]) -> Sequence[Course]:
    """The trials less all that was accepted."""
    for each in rounds:
        trials = trials if each.accepted is None else _without(trials, each.accepted)
    return trials


def _least_of_layers(
    layers: Kind | None,
    tried: Sequence[SlowCandidate],
    accepted: SlowCandidate | None,
    before: HeldOut,
    test: _Test,
) -> float | None:
    """How much several layers together must explain to be named instead of what was accepted: all that force
    free in position does, or half of what it does beyond another effect. None where there is no call to try.
    """
    if layers is None:
        return None
    if accepted is None:
        short = any(each.short_of_free and each.kind is layers.effect for each in tried)
        return test.free if short else None
    if accepted.kind is layers.effect or accepted.kind.name not in _IN_POSITION:
        return None
    explained = _explained(before, accepted.heldout, test.weight)
    return 0.5 * (explained + test.free) if explained < test.free else None


def _stack(
    kind: Kind, trials: Sequence[Course], before: HeldOut, test: _Test, beside: list[Array], least: float
) -> list[SlowCandidate]:
    """Several of a kind that together explain `least`, as a sheet of several layers; empty where they do not:
    steps come near to anything, if not quite."""
    found: list[SlowCandidate] = []
    best: list[SlowCandidate] = []
    rest, error = trials, before
    while len(found) < _MOST_LAYERS:
        others = [*beside, *(each.shape for each in found)]
        one = _try(kind, rest, error, replace(test, free=0.0), others)
        if not one.decision.accepted:
            break
        found.append(one)
        rest, error = _without(rest, one), one.heldout
        closer = _fitted_together(kind, found, rest, test.weight)
        explained = _explained(before, closer[-1].heldout, test.weight)
        if explained >= least:
            best = closer
            least = explained + _MORE * float(np.sum(closer[-1].heldout.error_n2 * test.weight**2))
    return best


def _with_together(
    rounds: Sequence[SlowRound], kind: Kind, rest: Sequence[Course], weight: Array
) -> list[SlowRound]:
    """The rounds with all that was accepted of a kind fitted at once; all found leave the `rest`."""
    found = [
        each.accepted for each in rounds if each.accepted is not None and each.accepted.kind is kind.effect
    ]
    if not kind.several or kind.own_phase or not found:
        return list(rounds)
    closer = _fitted_together(kind, found, rest, weight)
    settled_ = dict(zip(map(id, found), closer, strict=True))
    change = closer[-1].heldout.error_n2 - found[-1].heldout.error_n2
    # what was found after them was found beside them as they were
    behind = False
    for each in rounds:
        if behind and each.accepted is not None:
            error = np.maximum(each.accepted.heldout.error_n2 + change, 0.0)
            heldout = replace(each.accepted.heldout, error_n2=error)
            settled_[id(each.accepted)] = replace(each.accepted, heldout=heldout)
        behind = behind or each.accepted is found[-1]
    return [
        replace(
            each,
            candidates=tuple(settled_.get(id(one), one) for one in each.candidates),
            accepted=settled_.get(id(each.accepted), each.accepted),
        )
        for each in rounds
    ]


def _fitted_together(
    kind: Kind, found: Sequence[SlowCandidate], rest: Sequence[Course], weight: Array
) -> list[SlowCandidate]:
    """All that was accepted of a kind, its strengths fitted at once to what `rest` leaves when all that was
    found is taken out; layers also at places and with borders settled at once, where that leaves less."""
    trials = [
        replace(course, left_n=course.left_n + sum(added))
        for course, *added in zip(rest, *(each.added_n for each in found), strict=True)
    ]
    shapes = [each.shape for each in found]
    together_ = _at(kind, found, shapes, trials, rest, weight) if len(found) > 1 else list(found)
    if kind.stack is None:
        return together_
    places = settled(kind.stack(trials), shapes, len(trials), weight)
    closer = _at(kind, found, places, trials, rest, weight)
    first, then = (float(np.sum(way[-1].heldout.error_n2 * weight**2)) for way in (together_, closer))
    return closer if then < _CLOSER * first else together_


def _at(
    kind: Kind,
    found: Sequence[SlowCandidate],
    shapes: Sequence[Array],
    trials: Sequence[Course],
    rest: Sequence[Course],
    weight: Array,
) -> list[SlowCandidate]:
    """What was `found` of a kind at `shapes` [d], with strengths fitted at once to the `trials`, of which it
    has left the `rest`."""
    sums_, fold = together(kind, trials, shapes), found[-1].heldout.fold
    _, whole, _ = solve(sums_, np.ones(len(trials)), weight)
    by_fold = [solve(sums_, (fold != f).astype(float), weight)[1] for f in range(int(fold.max()) + 1)]
    # held-out errors change as those do on the trials as they are
    change = error_change(sums_, 0, np.stack([by_fold[f] for f in fold]))
    change -= [np.sum(b.left_n**2 - a.left_n**2, axis=0) for a, b in zip(trials, rest, strict=True)]
    last = found[-1].heldout
    heldout = replace(last, error_n2=np.maximum(last.error_n2 + change, 0.0), fits=None)
    own = len(whole) // len(shapes)
    settled_ = []
    for i, (each, shape) in enumerate(zip(found, shapes, strict=True)):
        part = slice(own * i, own * (i + 1))
        effect = kind.build(shape, whole[part])
        values = [as_values(kind.build(shape, c[part])) for c in by_fold]
        told = intervals(kind, effect, values, each.unsure)
        by_strength = {name for name in told if len({float(value[name]) for value in values}) > 1}
        parameters = {
            name: told[name] if name in by_strength else _centred(interval, told[name].value)
            for name, interval in each.decision.parameters.items()
        }
        columns = [kind.columns(course, shape) for course in trials]
        settled_.append(
            replace(
                each,
                effect=effect,
                shape=shape,
                heldout=heldout if i == len(found) - 1 else each.heldout,
                decision=replace(each.decision, parameters=parameters),
                added_n=tuple(c.own(x) @ whole[part] for c, x in zip(trials, columns, strict=True)),
                whole_n=tuple(x @ whole[part] for x in columns),
            )
        )
    return settled_


def _centred(interval: Interval, value: float) -> Interval:
    """An interval as wide, about another value."""
    away = value - interval.value
    return replace(interval, value=value, low=interval.low + away, high=interval.high + away)


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
    own = len(c) // (1 + len(beside))
    effect = kind.build(shapes[best], c[:own])
    error = np.zeros_like(before.error_n2)
    by_fold = []
    for fold in range(int(before.fold.max()) + 1):
        shape, c_without = fits.to((before.fold != fold).astype(float))
        held = before.fold == fold
        error[held] = (before.error_n2 + fits.error_change(shape, c_without))[held]
        by_fold.append(as_values(kind.build(shapes[shape], c_without[:own])))
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
        unsure += unsure_force(kind, trials, shapes[best], c[:own], weight)
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
