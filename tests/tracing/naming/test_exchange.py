"""Second thoughts about effects accepted early."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing.fitting.fit import base_starts, effect_starts, fit, reweighted
from mjx_cutting.tracing.fitting.heldout import folds
from mjx_cutting.tracing.fitting.problem import pose
from mjx_cutting.tracing.naming import exchange
from mjx_cutting.tracing.naming.candidate import Contest, Round, fitted, try_effect
from mjx_cutting.tracing.naming.exchange import reconsider
from mjx_cutting.tracing.records.lines import compress, trusted_band
from mjx_cutting.trials.synthetic import Hidden

RUNOUT, PITCH, SIZE = map(effect_class, ("radial_runout", "unequal_pitch", "size_effect"))


@pytest.fixture(scope="module")
def session(mill):
    """Runout and nothing else hidden: the problem, its lines, folds, and a way to try effects in a row."""
    with _platform.x64():
        dataset = mill(Hidden(runout_m=1.2e-5, runout_angle_rad=0.7), seed=2)
        lines = compress(dataset, trusted_band(dataset, None))
        fold = folds(dataset, 0)
        problem = pose(dataset, lines)
        base = fit(problem, (), base_starts(problem))
        problem = reweighted(problem, base)

        def tried(*kinds):
            """A round in which each of `kinds` was tried beside nothing; the best first."""
            alone, before = fitted(problem, lines, (), np.asarray(base.x), fold)
            starts = [effect_starts(problem, kind, alone.x)[-1] for kind in kinds]
            found = [
                try_effect(Contest(problem, lines, fold, kinds), (kind,), start, alone, before)
                for kind, start in zip(kinds, starts, strict=True)
            ]
            return before, found

        yield problem, lines, fold, tried


def after(session, first, others, last):
    """What second thoughts say where `first` was accepted among `others`, then `last`."""
    problem, lines, fold, tried = session
    before, found = tried(first, *others)
    one = Round(before, (), tuple(found), found[0])
    start = effect_starts(problem, last, found[0].fit.x)[-1]
    both, _ = fitted(problem, lines, (first, last), start, fold)
    two = Round(found[0].heldout, (), (), found[0])
    return *reconsider(problem, lines, (first, last), both.x, (one, two), fold), both


def test_an_effect_that_others_made_needless_is_taken_out(session):
    change, *_ = after(session, SIZE, (), RUNOUT)
    assert change is not None and change.place == 0
    assert change.round.accepted is None and change.effects == (RUNOUT,)
    problem, lines, fold, _ = session
    left, _ = fitted(problem, lines, change.effects, change.x, fold)
    assert left.model.effects[0].offset_m == pytest.approx(1.2e-5, rel=0.05)


def test_a_better_alternative_takes_the_place(session):
    change, _, before = after(session, PITCH, (RUNOUT,), SIZE)
    assert change is not None and change.effects == (RUNOUT, SIZE)
    assert change.round.accepted is not None and change.round.accepted.kind is RUNOUT
    problem, lines, fold, _ = session
    found, _ = fitted(problem, lines, change.effects, change.x, fold)
    assert found.squares < 0.5 * before.squares


def test_what_earns_its_place_keeps_it(session):
    change, rounds, _ = after(session, RUNOUT, (PITCH,), SIZE)
    assert change is None
    # it was held against its alternative beside what came later
    again = rounds[0].again
    assert again is not None and again.accepted is not None and again.accepted.kind is RUNOUT
    assert {each.kind for each in again.candidates} == {RUNOUT, PITCH}
    assert all(len(each.fit.model.effects) == 2 for each in again.candidates)


def test_an_effect_is_tried_again_beside_the_others_as_they_are_beside_it(session, monkeypatch):
    """Fitted without it they may go far from there, and then it is not found again."""
    begun = []

    def trying(contest, effects, start, *before):
        begun.append((effects[-1], np.asarray(start)))
        return try_effect(contest, effects, start, *before)

    monkeypatch.setattr(exchange, "try_effect", trying)
    change, _, both = after(session, RUNOUT, (PITCH,), SIZE)
    assert change is None
    (kind, start), (other, elsewhere) = begun
    base = len(both.x) - RUNOUT.size(session[0].tool) - SIZE.size(session[0].tool)
    runout, size = np.split(np.asarray(both.x)[base:], [RUNOUT.size(session[0].tool)])
    assert kind is RUNOUT and other is PITCH
    np.testing.assert_array_equal(start, np.concatenate([both.x[:base], size, runout]))
    assert np.abs(elsewhere[: base + len(size)] - start[: base + len(size)]).max() > 0.0
