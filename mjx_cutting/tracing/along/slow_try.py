"""One effect along the trials tried: its best shape, its held-out error, and whether it is accepted.

A named effect must also do most of what an unnamed one could: force that varies freely with position (hats
over the path) is fitted beside it, and where that does better by a sixth, the effect is not the cause. And
what changes with the place beside layers must do more than a border would that is not quite as supposed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.along.kind import Kind, as_values
from mjx_cutting.tracing.along.layers import borders_on, columns_of, together
from mjx_cutting.tracing.along.shapes import (
    Sums,
    added_energy,
    error_change,
    phases,
    solve,
    solve_in_phase,
    sums,
)
from mjx_cutting.tracing.along.slow_round import SlowCandidate
from mjx_cutting.tracing.along.surety import intervals, reach_of_the_model, unsure_force
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.problem import TOLERANCE
from mjx_cutting.tracing.naming.chance import chance_over_trials
from mjx_cutting.tracing.naming.decision import decide
from mjx_cutting.tracing.records.course import Course

FEWEST_REACHED = 3
IN_POSITION = ("material_periodicity", "layered_material", "entry_exit", "hysteresis", "clogging")
_HATS = 24
_HARDLY = 1e-3
_SHARE_OF_FREE = 0.85
_OF_LAYERS = 0.005
_ZOOMS = (1.0, 6.0, 36.0, 216.0)
Array = NDArray[np.floating]
Carrier = Callable[[Course], Array]
"""The waves of a trial [T, 3, k] that may vary with position, each by itself."""


@dataclass(frozen=True, eq=False)
class Asked:
    """What every effect of a round is held to: `weight` [3] of the axes; the fall of the error that force
    `free` in position brings; how many were tried (`tries`); `tolerance` and `in_range` of `search_slow`; the
    fall of the error that `layers` found before have brought."""

    weight: Array
    free: float
    tries: int
    tolerance: float
    in_range: bool
    layers: float = 0.0


def try_one(
    kind: Kind, trials: Sequence[Course], before: HeldOut, test: Asked, beside: Sequence[Array] = ()
) -> SlowCandidate:
    """The best of a kind, and whether it is accepted; those found `beside` it [d] are fitted anew with it."""
    weight = test.weight
    fits = _fits(kind, trials, weight, tuple(beside))
    shape, effect, c = fits.to(np.ones(len(trials)))
    after, added_n2, by_fold = fits.held_out(before)
    reached = _reached(kind, trials, fits.shapes[shape])
    told_n2 = None if kind.own_phase else added_n2[reached]
    p = chance_over_trials(before.only(reached), after.only(reached), test.tries, told_n2)
    reach = reach_of_the_model(kind, trials, fits.shapes[shape])
    error_of_it = reach * TOLERANCE
    accounted = float(np.sqrt(max(before.nrmse**2 - after.nrmse**2, error_of_it**2, 1e-24)))
    unsure = error_of_it / accounted
    parameters = intervals(kind, effect, by_fold, unsure)
    off = reach * test.tolerance
    decision = decide(kind.effect, before, after, p, parameters, tolerance=off, in_range=test.in_range)
    if decision.accepted:
        # that it is there does not hang on how large the force is; how large a share of it, does
        unsure += unsure_force(kind, trials, fits.shapes[shape], c[: fits.own(c)], weight)
        decision = replace(decision, parameters=intervals(kind, effect, by_fold, unsure))
    explained = fall_of_error(before, after, weight)
    short = decision.accepted and kind.name in IN_POSITION and explained < _SHARE_OF_FREE * test.free
    if short:
        ratio = test.free / max(explained, 1e-300)
        why = f"force that varies freely with position explains {ratio:.1f} times as much"
        decision = replace(decision, accepted=False, reasons=(why,))
    if decision.accepted and kind.name in IN_POSITION and explained < _OF_LAYERS * test.layers:
        why = (
            f"does {explained / test.layers:.2%} of what layers do, whose borders may be that much otherwise"
        )
        decision = replace(decision, accepted=False, reasons=(why,))
    rather = None if beside and borders_on(fits.shapes[shape], beside) else kind.rather
    if decision.accepted and rather is not None and (why := rather(trials, effect)):
        decision = replace(decision, accepted=False, reasons=(why,))
    added, whole = [], []
    for course, one in zip(trials, fits.in_each(shape, c), strict=True):
        columns = fits.columns(course, shape)
        added.append(course.own(columns) @ one)
        whole.append(columns @ one)
    return SlowCandidate(
        kind.effect, effect, after, decision, tuple(added), tuple(whole), short, fits.shapes[shape], unsure
    )


def fall_of_error(before: HeldOut, after: HeldOut, weight: Array) -> float:
    """Fall of the weighted squared error on held-out trials."""
    return float(np.sum((before.error_n2 - after.error_n2) * weight**2))


def whole_force(course: Course) -> Array:
    """[T, 3, 1] the force of chip and edge, N."""
    return (course.chip_n + course.edge_n)[..., None]


def free_in_position(
    trials: Sequence[Course],
    before: HeldOut,
    weight: Array,
    carrier: Carrier = whole_force,
) -> float:
    """Fall of the weighted squared error on held-out trials that force free to vary with position brings,
    each of the waves of `carrier` [T, 3, k] by itself."""
    low = min(float(each.position_m.min()) for each in trials)
    high = max(float(each.position_m.max()) for each in trials)
    knots = np.linspace(low, high, _HATS)
    width = max(knots[1] - knots[0], 1e-9)

    def hats(course: Course, shape: Array) -> Array:
        share = np.clip(1.0 - np.abs(course.position_m[:, None] - knots) / width, 0.0, 1.0)
        waves = np.moveaxis(carrier(course), -1, 0)
        return np.concatenate([wave[..., None] * share[:, None, :] for wave in waves], axis=-1)

    found = sums(hats, trials, np.zeros((1, 1)))
    fall = 0.0
    for fold in range(int(before.fold.max()) + 1):
        _, c, _ = solve(found, (before.fold != fold).astype(float), weight)
        held = before.fold == fold
        fall -= float(np.sum(error_change(found, 0, c)[held] * weight**2))
    return max(fall, 0.0)


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

    def to(self, use: Array) -> tuple[int, AbstractEffect, Array]:
        """Best shape over the trials used, the effect it is, and its coefficients [k] with those of the
        others behind them."""
        if self.kind.own_phase:
            best, c = solve_in_phase(self.found, use, self.weight)
        else:
            best, c, _ = solve(self.found, use, self.weight, self.kind.shared)
            if self.beside:
                c = solve(self._at(best)[0], use, self.weight)[1]
        return best, self.kind.build(self.shapes[best], c[: self.own(c)]), c

    def held_out(self, before: HeldOut) -> tuple[HeldOut, Array, list[dict[str, Any]]]:
        """The error on the folds of `before` once the effect is fitted without them, the energy [R] of what
        it then adds to them, N^2, and what it is."""
        error, added = np.zeros_like(before.error_n2), np.zeros(len(before.fold))
        by_fold = []
        for fold in range(int(before.fold.max()) + 1):
            held = before.fold == fold
            shape, effect, c = self.to((~held).astype(float))
            error[held] = (before.error_n2 + self.error_change(shape, c))[held]
            added[held] = added_energy(*self._at(shape), self.in_each(shape, c)).sum(axis=1)[held]
            by_fold.append(as_values(effect))
        return HeldOut(np.maximum(error, 0.0), before.energy_n2, None, before.fold), added, by_fold

    def own(self, c: Array) -> int:
        """How many of the coefficients [k] are the effect's own."""
        return len(c) // (1 + len(self.beside))

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


def _fits(kind: Kind, trials: Sequence[Course], weight: Array, beside: tuple[Array, ...]) -> _Fits:
    """Fits over the grid of a kind, refined about what is best on all trials."""
    grid, everyone = kind.grid(trials), np.ones(len(trials))
    shapes, found = grid, kind.sums_of(trials, grid)
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
    return _Fits(kind, trials, found, shapes, weight, beside)
