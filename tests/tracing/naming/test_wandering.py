"""Few levels say no more than the force within them does: where it wanders, what they differ by is chance."""

from __future__ import annotations

import pytest

from benchmarks.study import make
from benchmarks.study.fewer import FEWER
from mjx_cutting.tracing import trace


def _of_five(effects: dict[str, str], seed: int, design: str):
    return trace(FEWER["five"](make(design, effects, seed).dataset), effects=("flank_wear", "size_effect"))


@pytest.mark.parametrize("cause", ["position_slope", "random_walk_gain", "feed_speed_cross"])
def test_a_cause_that_moves_the_force_within_five_holes_too_is_no_wear(cause):
    """With a run-in and a late stage wear goes through nearly any five levels."""
    found = _of_five({cause: "strong"}, 9955, "drill")
    assert found.verdict["verdict"] == "unexplained" and not found.kinds


@pytest.mark.parametrize(("design", "seed"), [("drill", 9953), ("turning", 9950)])
def test_wear_of_five_cuts_is_named(design, seed):
    found = _of_five({"flank_wear": "medium"}, seed, design)
    assert [kind.name for kind in found.kinds] == ["flank_wear"]


def test_what_is_refused_says_by_how_much_the_force_wanders():
    found = _of_five({"random_walk_gain": "strong"}, 9955, "drill")
    reasons = [why for each in found.search.rounds[0].candidates for why in each.decision.reasons]
    assert any("what is left wanders" in why for why in reasons)
