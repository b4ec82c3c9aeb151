"""A size effect with another exponent for every direction of the force is no ploughing."""

from __future__ import annotations

import pytest

from benchmarks.study.designs import plan
from benchmarks.study.generator import recorded
from mjx_cutting.tracing import trace
from mjx_cutting.trials.dataset import Dataset

pytestmark = pytest.mark.slow
TRIED = ("ploughing", "size_effect", "flank_wear")
BY_DIRECTION = {"exponent": 0.24, "radial_ratio": 1.75, "axial_ratio": 1.25}


def _session(design: str, size_effect: dict[str, float]) -> Dataset:
    session, trials = recorded(plan(design, 401), {"size_effect": size_effect}, 401)
    told = {"name": "size", "source": "benchmarks/study", "licence": "Apache-2.0"}
    return Dataset(**told, tool=session.tool, sensor=session.sensor, trials=trials)


@pytest.mark.parametrize("design", ["mill", "turning", "drill"])
def test_every_direction_that_shows_has_an_exponent_of_its_own(design: str):
    found = trace(_session(design, BY_DIRECTION), effects=TRIED).verdict
    (named,) = found["effects"]
    assert (found["verdict"], named["name"]) == ("explained", "size_effect")
    values = {name: each["value"] for name, each in named["parameters"].items()}
    assert values["exponent"] == pytest.approx(0.24, rel=0.03)
    assert values["axial_ratio"] == pytest.approx(1.25, rel=0.05)
    # torque and thrust of a drill show nothing of the radial force
    assert values["radial_ratio"] == pytest.approx(1.0 if design == "drill" else 1.75, rel=0.05)
    assert found["after"]["heldout_nrmse"] < 1.2 * found["noise_floor_nrmse"]


def test_one_exponent_is_told_as_one():
    found = trace(_session("turning", {"exponent": 0.2}), effects=TRIED).verdict
    (named,) = found["effects"]
    assert (named["name"], named["parameters"]["exponent"]["value"]) == (
        "size_effect",
        pytest.approx(0.2, rel=0.03),
    )
    # unknowns that explain nothing are not taken in
    assert [named["parameters"][name]["value"] for name in ("radial_ratio", "axial_ratio")] == [1.0, 1.0]
