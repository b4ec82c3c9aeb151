"""Steady effects that take next to nothing of what is missing are not its cause."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.naming.lesser_part import rather_the_rest


def _heldout(nrmse: float) -> HeldOut:
    energy = np.full((4, 3), 100.0)
    return HeldOut(nrmse**2 * energy, energy, None, np.arange(4))


@pytest.mark.parametrize(
    ("after", "floor", "named"),
    [(0.098, 0.01, False), (0.08, 0.01, True), (0.098, 0.097, True)],
    ids=["leaves nearly all", "leaves much", "leaves but noise"],
)
def test_what_noise_leaves_does_not_count_as_missing(after, floor, named):
    assert (rather_the_rest(_heldout(0.1), _heldout(after), floor) is None) is named


@pytest.mark.slow
def test_a_force_that_remembers_is_not_called_compliance():
    """It lies between the lines for the most part; a compliant arm would take a third of what is in them."""
    found = trace(make("mill", {"previous_force": "strong"}, 403).dataset, effects=("static_compliance",))
    assert found.verdict["verdict"] == "unexplained" and found.verdict["effects"] == []
    assert found.verdict["after"]["heldout_nrmse"] == found.verdict["before"]["heldout_nrmse"]
    assert found.search.rounds[0].candidates[0].decision.reasons
