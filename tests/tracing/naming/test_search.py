"""Which of the candidates of a round is accepted."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.naming.search import _accepted, shortlist


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


@pytest.mark.slow
def test_a_drift_is_looked_for_beside_wear_that_grows_within_the_holes():
    # What wear explains between the lines of a hole does not make what is left in its level any less.
    case = make("drill", {"flank_wear": "medium", "thermal_drift": "medium"}, 404)
    said = trace(case.dataset, effects=("flank_wear", "thermal_drift")).verdict
    assert said["verdict"] == "explained"
    assert [each["name"] for each in said["effects"]] == ["flank_wear", "thermal_drift"]
    drift = said["effects"][1]["parameters"]
    true = case.truth["effects"]["thermal_drift"]
    assert drift["drift_n"]["values"][2] == pytest.approx(true["drift_n"][2], rel=0.25)
    assert drift["tau_s"]["low"] < true["tau_s"] < drift["tau_s"]["high"]


@pytest.mark.slow
def test_an_arm_that_swings_in_two_directions_has_two_modes_and_one_name(hiding):
    along = {"mass_ratio": 0.3, "frequency_hz": 180.0, "damping": 0.04, "direction_rad": 0.1}
    across = {"mass_ratio": 0.2, "frequency_hz": 235.0, "damping": 0.03, "direction_rad": 1.6}
    dataset = hiding({"robot_mode": {**along, "others": [across]}})
    found = trace(dataset, effects=("robot_mode", "clamp_mode", "sensor_resonance", "radial_runout"))
    (named,) = found.verdict["effects"]
    assert (found.verdict["verdict"], named["name"]) == ("explained", "robot_mode")
    assert any(said.startswith("and another: mass_ratio") for said in named["evidence"])
    modes = sorted(found.model.effects, key=lambda each: each.frequency_hz)
    for mode, true in zip(modes, (along, across), strict=True):
        for name in ("mass_ratio", "frequency_hz", "damping"):
            assert getattr(mode, name) == pytest.approx(true[name], rel=0.03)
        assert np.sin(mode.direction_rad - true["direction_rad"]) == pytest.approx(0.0, abs=0.05)


def test_what_the_search_was_here_for_before_is_fitted_again_though_it_explains_nothing():
    def screened(name: str, share: float) -> SimpleNamespace:
        return SimpleNamespace(kind=SimpleNamespace(name=name), share=share)

    shares = {"one": 0.5, "two": 0.0, "three": 0.2, "four": 0.005, "five": 0.004}
    given = [screened(name, share) for name, share in shares.items()]
    assert [each.kind.name for each in shortlist(given)] == ["one", "two", "three"]
    seen = {"five", "three"}
    assert [each.kind.name for each in shortlist(given, seen)] == ["one", "two", "three", "five"]
