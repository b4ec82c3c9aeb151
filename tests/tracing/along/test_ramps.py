"""The end of a sheet is found though most records end before the tool is fully in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.along.ramps import changes_at_an_end, ends_in_pieces


def test_places_are_looked_for_from_the_first_touch_on(mill):
    near, far = ends_in_pieces(mill())
    assert near.places_m[0] == pytest.approx(-0.008)  # a slot of 16 mm: the radius before the path begins
    assert near.places_m[-1] < far.places_m[-1]
    assert (near.far, far.far) == (False, True)
    at_start = near.build([1.0, 0.4], None).values()
    assert at_start["start_m"] == pytest.approx(2e-3) and at_start["length_m"] >= 1e3


@pytest.mark.parametrize("side", [1, -1])
def test_a_cut_that_begins_or_ends_with_another_force_is_seen(mill, side):
    made = mill()
    assert not changes_at_an_end(made)
    last = made.trials[-1]
    ramp = np.minimum(np.linspace(0.5, 3.0, last.samples)[::side], 1.0)
    rising = replace(last, force_n=last.force_n * ramp[:, None])
    assert changes_at_an_end(replace(made, trials=(*made.trials[:-1], rising)))


@pytest.mark.slow
def test_an_end_of_the_sheet_is_found_though_most_trials_stay_in_the_ramp():
    """Of nine slots three go as far as the tool is wide; their speeds cannot be read from smeared lines."""
    case = make("mill", {"entry_exit": "medium"}, 404)
    verdict = trace(case.dataset, effects=("entry_exit", "helix_lag")).verdict
    assert [each["name"] for each in verdict["effects"]] == ["entry_exit"]
    found, true = verdict["effects"][0]["parameters"], case.truth["effects"]["entry_exit"]
    assert found["start_m"]["value"] == pytest.approx(true["start_m"], abs=1e-4)
    assert found["share"]["value"] == pytest.approx(1.0, abs=0.05)
    assert verdict["after"]["heldout_nrmse"] < 0.1 * verdict["before"]["heldout_nrmse"]


@pytest.mark.slow
def test_what_is_found_in_pieces_stands_where_the_cut_alone_leaves_more():
    """Five of nine slots end within the way in, so that little is left of where the tool is fully in."""
    case = make("mill", {"entry_exit": "medium"}, 410)
    verdict = trace(case.dataset, effects=("entry_exit", "helix_lag")).verdict
    (named,) = verdict["effects"]
    assert named["name"] == "entry_exit"
    assert named["parameters"]["share"]["value"] == pytest.approx(1.0, abs=0.02)
    start = named["parameters"]["start_m"]
    assert start["low"] < case.truth["effects"]["entry_exit"]["start_m"] < start["high"]
    assert verdict["after"]["heldout_nrmse"] < 0.06 * verdict["before"]["heldout_nrmse"]
