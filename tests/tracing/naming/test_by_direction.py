"""A size effect with another exponent for every direction of the force.

The drill and the turning tool of the study have three feeds each. Ploughing, with a stiffness for each
direction, then bends the force the same way."""

from __future__ import annotations

import pytest

from mjx_cutting.tracing import trace

pytestmark = pytest.mark.slow
TRIED = ("ploughing", "size_effect", "flank_wear")
BY_DIRECTION = {"exponent": 0.24, "radial_ratio": 1.75, "axial_ratio": 1.25}


@pytest.mark.parametrize("design", ["mill", "turning", "drill"])
def test_every_direction_that_shows_has_an_exponent_of_its_own(hiding, design: str):
    found = trace(hiding({"size_effect": BY_DIRECTION}, design=design), effects=TRIED).verdict
    (named,) = found["effects"]
    open_ = [set(each["names"]) for each in found["ambiguous"]]
    assert (named["name"], open_) == (
        "size_effect",
        [] if design == "mill" else [{"size_effect", "ploughing"}],
    )
    values = {name: each["value"] for name, each in named["parameters"].items()}
    assert values["exponent"] == pytest.approx(0.24, rel=0.03)
    assert values["axial_ratio"] == pytest.approx(1.25, rel=0.05)
    # torque and thrust of a drill show nothing of the radial force
    assert values["radial_ratio"] == pytest.approx(1.0 if design == "drill" else 1.75, rel=0.05)
    assert found["after"]["heldout_nrmse"] < 1.2 * found["noise_floor_nrmse"]


def test_one_exponent_is_told_as_one(hiding):
    found = trace(hiding({"size_effect": {"exponent": 0.2}}, design="turning"), effects=TRIED).verdict
    (named,) = found["effects"]
    assert (named["name"], named["parameters"]["exponent"]["value"]) == (
        "size_effect",
        pytest.approx(0.2, rel=0.03),
    )
    # unknowns that explain nothing are not taken in
    assert [named["parameters"][name]["value"] for name in ("radial_ratio", "axial_ratio")] == [1.0, 1.0]
