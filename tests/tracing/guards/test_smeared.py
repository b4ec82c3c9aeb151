"""A spindle that turns unevenly takes nothing from the force, it moves it beside the lines."""

from __future__ import annotations

import pytest

from benchmarks.study import make
from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing import trace

DAMPING = ("helix_lag", "sensor_lowpass")


@pytest.mark.slow
def test_an_uneven_spindle_is_called_neither_a_helix_nor_a_filter():
    case = make("mill", {"speed_wander": "strong"}, 401)
    found = trace(case.dataset, effects=DAMPING)
    reasons = [each.decision.reasons for each in found.search.rounds[0].candidates]
    assert found.verdict["effects"] == [] and found.verdict["verdict"] == "unexplained"
    assert any("nothing is lost" in why for each in reasons for why in each)


@pytest.mark.slow
def test_a_filter_that_takes_energy_is_named():
    case = make("mill", {"sensor_lowpass": "weak"}, 401)
    assert [each["name"] for each in trace(case.dataset, effects=DAMPING).verdict["effects"]] == [
        "sensor_lowpass"
    ]


def test_both_say_that_they_damp():
    assert all(effect_class(name).damps for name in DAMPING)
