"""A transducer that is not the same on every axis is a resonance, told by axis."""

from __future__ import annotations

import pytest

from mjx_cutting.cutting.effects.sensor_resonance import STIFF
from mjx_cutting.tracing import trace

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("frequency_ratio", "damping_ratio"),
    [(1.6, 1.4), (0.7, 1.0), (1.0, 1.0)],
    ids=["stiffer", "softer", "alike"],
)
def test_frequency_and_damping_along_the_axis_are_found(hiding, frequency_ratio: float, damping_ratio: float):
    hidden = {
        "frequency_hz": 420.0,
        "damping": 0.05,
        "axial_frequency_ratio": frequency_ratio,
        "axial_damping_ratio": damping_ratio,
    }
    dataset = hiding({"sensor_resonance": hidden})
    found = trace(dataset, effects=("robot_mode", "clamp_mode", "sensor_resonance", "radial_runout"))
    (named,) = found.verdict["effects"]
    assert (found.verdict["verdict"], named["name"]) == ("explained", "sensor_resonance")
    values = {name: each["value"] for name, each in named["parameters"].items()}
    assert values["frequency_hz"] == pytest.approx(420.0, rel=0.01)
    assert values["axial_frequency_ratio"] == pytest.approx(frequency_ratio, rel=0.02)
    assert values["axial_damping_ratio"] == pytest.approx(damping_ratio, rel=0.3)
    if frequency_ratio == 1.0:
        # unknowns that explain nothing are not taken in
        assert values["axial_frequency_ratio"] == 1.0


def test_a_transducer_that_is_another_on_every_axis_is_told_by_axis(hiding):
    hidden = {
        "frequency_hz": 460.0,
        "damping": 0.05,
        "axial_frequency_ratio": 1.5,
        "axial_damping_ratio": 0.8,
        "lateral_frequency_ratio": 0.92,
        "lateral_damping_ratio": 1.2,
    }
    found = trace(hiding({"sensor_resonance": hidden}), effects=("robot_mode", "sensor_resonance"))
    (named,) = found.verdict["effects"]
    assert (found.verdict["verdict"], named["name"]) == ("explained", "sensor_resonance")
    values = {name: each["value"] for name, each in named["parameters"].items()}
    for name in ("frequency_hz", "axial_frequency_ratio", "lateral_frequency_ratio"):
        assert values[name] == pytest.approx(hidden[name], rel=0.02)
    for name in ("damping", "axial_damping_ratio", "lateral_damping_ratio"):
        assert values[name] == pytest.approx(hidden[name], rel=0.3)


def test_an_axis_on_which_the_transducer_does_not_resonate_is_stiff(hiding):
    """At so high a frequency along z that no number tells it, of which the range has no end to run to."""
    hidden = {"frequency_hz": 420.0, "damping": 0.05, "axial_frequency_ratio": 50.0}
    found = trace(hiding({"sensor_resonance": hidden}), effects=("robot_mode", "sensor_resonance"))
    (named,) = found.verdict["effects"]
    assert (found.verdict["verdict"], named["name"]) == ("explained", "sensor_resonance")
    values = {name: each["value"] for name, each in named["parameters"].items()}
    assert values["frequency_hz"] == pytest.approx(420.0, rel=0.01)
    assert (values["axial_frequency_ratio"], values["lateral_frequency_ratio"]) == (STIFF, 1.0)
