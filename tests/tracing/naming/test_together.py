"""Two effects of which neither stands out alone are named together; what only looks like two is not."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.naming.together import _exchanged, _little_is_left

LAWS = ("size_effect", "thermal_drift", "flank_wear", "crosstalk")


def test_a_size_effect_and_a_drift_that_hide_each_other_are_both_named():
    case = make("turning", {"size_effect": 2.0, "thermal_drift": 4.0}, 500)
    found = trace(case.dataset, effects=LAWS)
    said = found.verdict
    assert said["verdict"] == "explained"
    assert {each["name"] for each in said["effects"]} == {"size_effect", "thermal_drift"}
    # neither passes alone
    for name in ("size_effect", "thermal_drift"):
        assert trace(case.dataset, effects=(name, "crosstalk")).verdict["effects"] == []
    true = case.truth["effects"]
    parameters = {each["name"]: each["parameters"] for each in said["effects"]}
    assert parameters["size_effect"]["exponent"]["value"] == pytest.approx(
        true["size_effect"]["exponent"], rel=0.02
    )
    np.testing.assert_allclose(
        parameters["thermal_drift"]["drift_n"]["values"], true["thermal_drift"]["drift_n"], rtol=0.1, atol=0.3
    )
    # each is told by what it brings beside the other
    assert all(each["heldout_gain"] > 0.5 * said["before"]["heldout_nrmse"] for each in said["effects"])


def test_a_gain_that_switches_at_random_is_not_two_effects():
    case = make("turning", {"gain_switching": "strong"}, 500)
    assert trace(case.dataset, effects=LAWS).verdict["verdict"] == "unexplained"


def _leaves(error: float) -> HeldOut:
    return HeldOut(np.full((4, 3), error**2 / 3.0), np.full((4, 3), 1.0 / 3.0), None, np.arange(4))


@pytest.mark.parametrize(
    ("first", "second", "both", "little"),
    [(0.06, 0.08, 0.01, True), (0.06, 0.08, 0.05, False), (0.012, 0.08, 0.01, False)],
    ids=["both are needed", "much is left", "the first does nearly all"],
)
def test_a_pair_must_leave_little_and_need_both(first, second, both, little):
    left = (_leaves(each) for each in (0.1, first, second, both))
    assert _little_is_left(*left) is little


def test_unknowns_of_two_effects_change_places():
    x = np.arange(9.0)
    exchanged = _exchanged(x, 2, 3)
    np.testing.assert_array_equal(exchanged, [0, 1, 2, 3, 7, 8, 4, 5, 6])
    np.testing.assert_array_equal(_exchanged(exchanged, 3, 2), x)
