"""A spindle that turns unevenly takes nothing from the force, it moves it beside the lines."""

from __future__ import annotations

import pytest

from benchmarks.study import make
from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.guards.smeared import _beside_n2
from mjx_cutting.tracing.records.lines import compress

DAMPING = ("helix_lag", "sensor_lowpass")


@pytest.mark.slow
@pytest.mark.parametrize("heard", [True, False])
def test_an_uneven_spindle_is_called_neither_a_helix_nor_a_filter(monkeypatch, heard):
    """Where the slow part of its wandering is followed hardly anything is taken; else a filter would fit."""
    if not heard:
        monkeypatch.setattr("mjx_cutting.tracing.once.as_heard", lambda dataset: dataset)
    case = make("mill", {"speed_wander": "strong"}, 401)
    found = trace(case.dataset, effects=DAMPING)
    reasons = [each.decision.reasons for each in found.search.rounds[0].candidates]
    assert found.verdict["effects"] == [] and found.verdict["verdict"] == "unexplained"
    assert heard or any("nothing is lost" in why for each in reasons for why in each)


@pytest.mark.slow
def test_a_filter_that_takes_energy_is_named():
    case = make("mill", {"sensor_lowpass": "weak"}, 401)
    assert [each["name"] for each in trace(case.dataset, effects=DAMPING).verdict["effects"]] == [
        "sensor_lowpass"
    ]


@pytest.mark.parametrize(("hidden", "share"), [({}, 0.0), ({"speed_wander": "strong"}, 0.8)])
def test_white_noise_beside_the_lines_was_taken_from_none(hidden, share):
    """Where little is lost, noise between the lines is more than that."""
    lines = compress(make("mill", hidden, 401).dataset, (0.0, 400.0))
    beside = _beside_n2(lines).sum() / lines.rest_n2.sum()
    assert share <= beside < share + 0.2


def test_both_say_that_they_damp():
    assert all(effect_class(name).damps for name in DAMPING)
