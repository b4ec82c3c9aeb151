"""Which of the candidates of a round is accepted."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from benchmarks.study import make
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.naming.search import _accepted


def _candidate(gain: float, accepted: bool, scattered: bool = False) -> SimpleNamespace:
    return SimpleNamespace(decision=SimpleNamespace(accepted=accepted, gain=gain, scattered=scattered))


@pytest.mark.parametrize(
    ("best", "named"),
    [
        (_candidate(0.3, accepted=True), 0.3),
        (_candidate(0.3, accepted=False), 0.1),
        (_candidate(0.3, accepted=False, scattered=True), None),
        (_candidate(0.11, accepted=False, scattered=True), 0.1),
    ],
    ids=["it passes", "it fails", "it fails by its scatter only", "so it does, but is hardly better"],
)
def test_nothing_is_named_in_the_place_of_a_much_better_candidate_that_is_unsure(best, named):
    found = _accepted([best, _candidate(0.1, accepted=True)])
    assert (found.decision.gain if found else None) == named


@pytest.mark.slow
def test_a_drift_that_one_cold_trial_shows_most_is_not_called_wear():
    case = make("mill", {"thermal_drift": "medium"}, 402)
    found = trace(case.dataset, effects=("flank_wear", "thermal_drift")).verdict
    assert [each["name"] for each in found["effects"]] == ["thermal_drift"]
