"""Which other effect counts as a second explanation of what one was named for."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mjx_cutting.cutting.effects import ClampMode, FlankWear, Ploughing, RobotMode, SizeEffect
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.telling import ties


def _heldout(*by_trial: tuple[float, float, float]) -> HeldOut:
    return HeldOut(np.array(by_trial), np.full((len(by_trial), 3), 10.0), None, np.arange(len(by_trial)))


def _candidate(kind, heldout: HeldOut, guarded: bool = False, unknowns: int = 9) -> SimpleNamespace:
    decision = SimpleNamespace(accepted=not guarded, untold=False, guarded=guarded)
    return SimpleNamespace(kind=kind, heldout=heldout, decision=decision, told=unknowns)


def _of_a(tool: str) -> SimpleNamespace:
    return SimpleNamespace(tool=SimpleNamespace(kind=tool))


@pytest.mark.parametrize(
    ("tool", "other", "unknowns", "tied"),
    [
        ("turning", Ploughing, 11, False),
        ("turning", Ploughing, 10, True),
        ("end_mill", Ploughing, 11, True),
        ("turning", FlankWear, 11, True),
    ],
    ids=["more for the same bend", "as many", "a cutter shows more than a bend", "wear is no bend"],
)
def test_a_law_of_more_unknowns_is_no_second_explanation_of_levels(tool, other, unknowns, tied, monkeypatch):
    monkeypatch.setattr(ties, "_settles", lambda *_: "five feeds")
    after, before = _heldout(*[(0.1, 0.1, 0.1)] * 4), _heldout(*[(1.0, 1.0, 1.0)] * 4)
    best, rival = _candidate(SizeEffect, after, unknowns=10), _candidate(other, after, unknowns=unknowns)
    each = SimpleNamespace(accepted=best, candidates=(best, rival), before=before, again=None)
    found = ties.tie(each, [SizeEffect], _of_a(tool), None, SimpleNamespace(problem=None), floor=0.0)
    assert (found is not None) is tied


@pytest.mark.parametrize(
    ("rival", "tied"),
    [([(0.1, 1.0, 1.0)] * 4, True), ([(1.0, 0.1, 1.0)] * 4, False)],
    ids=["the same part of the force", "another axis of it"],
)
def test_a_tie_is_with_what_explains_the_same(rival, tied, monkeypatch):
    monkeypatch.setattr(ties, "_settles", lambda *_: "another pose")
    best = _candidate(RobotMode, _heldout(*[(0.1, 1.0, 1.0)] * 4))
    other = _candidate(ClampMode, _heldout(*rival))
    before = _heldout(*[(1.0, 1.0, 1.0)] * 4)
    each = SimpleNamespace(accepted=best, candidates=(best, other), before=before, again=None)
    found = ties.tie(each, [RobotMode], _of_a("end_mill"), None, SimpleNamespace(problem=None), floor=0.0)
    assert (found is not None) is tied
    if tied:
        assert found["names"] == ["robot_mode", "clamp_mode"]
        assert found["cosine"] == pytest.approx(1.0)
        # beside what was found later the other explains nothing of it
        later = SimpleNamespace(**vars(each) | {"candidates": (best, _candidate(ClampMode, before))})
        each.again = later
        assert (
            ties.tie(each, [RobotMode], _of_a("end_mill"), None, SimpleNamespace(problem=None), floor=0.0)
            is None
        )


@pytest.mark.parametrize(
    ("left", "rival", "tied"),
    [((0.4, 0.4, 0.4), 0.45, True), ((0.4, 0.4, 0.4), 0.7, False), ((0.02, 0.02, 0.02), 0.05, False)],
    ids=["hardly worse beside what is left", "worse", "next to nothing is left"],
)
def test_where_much_is_left_one_that_a_guard_refused_may_be_as_good(left, rival, tied, monkeypatch):
    """The gap is the same in every trial, beyond any standard error: what neither explains may make it."""
    monkeypatch.setattr(ties, "_settles", lambda *_: "another feed")
    best = _candidate(RobotMode, _heldout(*[left] * 4))
    other = _candidate(ClampMode, _heldout(*[(rival,) * 3] * 4), guarded=True)
    each = SimpleNamespace(
        accepted=best, candidates=(best, other), before=_heldout(*[(2.0, 2.0, 2.0)] * 4), again=None
    )
    found = ties.tie(each, [RobotMode], _of_a("end_mill"), None, SimpleNamespace(problem=None), floor=0.03)
    assert (found is not None) is tied


@pytest.mark.parametrize(
    ("tool", "best", "rival", "unknowns", "tied"),
    [
        ("end_mill", 0.02, 0.03, 9, False),
        ("end_mill", 0.02, 0.03, 8, True),
        ("turning", 0.02, 0.03, 9, True),
        ("end_mill", 0.02, 0.0201, 9, True),
        ("end_mill", 0.025, 0.035, 9, True),
    ],
    ids=[
        "noise tells",
        "by fewer unknowns",
        "levels scatter",
        "as close to the noise",
        "more than noise left",
    ],
)
def test_where_the_better_leaves_noise_alone_the_other_is_told_by_that(
    tool, best, rival, unknowns, tied, monkeypatch
):
    """A part of the trials shows what tells the two apart, so that the gap scatters over trials."""
    monkeypatch.setattr(ties, "_settles", lambda *_: "another feed")
    energy, shown = np.full((8, 3), 1e4), np.repeat([0.0, 4.0], [6, 2])[:, None]
    first, second = (HeldOut(each**2 * energy, energy, None, np.arange(8)) for each in (best, rival))
    second = HeldOut(first.error_n2 + shown * (second.error_n2 - first.error_n2), energy, None, np.arange(8))
    before = HeldOut(0.1**2 * energy, energy, None, np.arange(8))
    named = _candidate(SizeEffect, first, unknowns=9)
    beside = _candidate(Ploughing, second, unknowns=unknowns)
    each = SimpleNamespace(accepted=named, candidates=(named, beside), before=before, again=None)
    found = ties.tie(each, [SizeEffect], _of_a(tool), None, SimpleNamespace(problem=None), floor=0.02)
    assert (found is not None) is tied
