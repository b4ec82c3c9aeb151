"""A tooth that breaks in the middle of a session."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting.cutting import ForceModel
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.naming.onset import broken_between

START_M = np.array([3.0, 0.0, 1.0, 2.0, 4.0, 5.0])
END_M = START_M + 0.5


@pytest.mark.parametrize(
    ("apart", "between"),
    [
        ([0.9, 0.003, 0.002, 0.004, 1.1, 0.95], (2.5, 3.0)),
        ([0.9, 1.0, 1.1, 0.95, 1.1, 0.95], None),  # broken all along
        ([0.004, 0.9, 0.8, 1.1, 0.003, 0.005], None),  # mended, not broken
        ([0.3, 0.1, 0.15, 0.2, 0.4, 0.5], None),  # it grows: runout at falling feeds, say
        ([0.004, 0.003, 0.002, 0.004, 0.003, 0.9], None),  # one trial alone proves nothing
    ],
)
def test_trials_part_where_the_teeth_become_unlike(apart, between):
    assert broken_between(np.array(apart), START_M, END_M) == between


def test_lengths_that_are_not_given_tell_no_order():
    assert broken_between(np.array([0.003, 0.002, 0.9, 0.9]), np.zeros(4), np.full(4, 0.5)) is None


@pytest.mark.slow
def test_a_tooth_that_breaks_between_two_trials_is_found_with_when():
    whole, broken = (make("mill", hidden, seed=401).dataset for hidden in ({}, {"broken_tooth": "strong"}))
    cuts = [each for each in whole.trials if each.kind == "cut"]
    lengths = sorted(each.cut_length_before_m for each in cuts)
    when = lengths[len(lengths) // 2]
    trials = tuple(
        late if late.cut_length_before_m >= when else early
        for early, late in zip(whole.trials, broken.trials, strict=True)
    )
    found = trace(replace(whole, trials=trials), effects=["broken_tooth", "radial_runout", "unequal_pitch"])
    (tooth,) = found.verdict["effects"]
    assert tooth["name"] == "broken_tooth" and found.verdict["verdict"] == "explained"
    onset = tooth["parameters"]["onset_m"]
    assert lengths[len(lengths) // 2 - 1] < onset["low"] <= onset["value"] <= onset["high"]
    assert onset["high"] == pytest.approx(when)
    late = sum(each.cut_length_before_m >= when for each in cuts)
    assert any(f"the same in {late} from then on" in each for each in tooth["evidence"])
    assert ForceModel.from_dict(found.model.to_dict()).effects[0].onset_m == onset["value"]
