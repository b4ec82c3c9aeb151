"""A tooth that breaks within a trial: the trial is parted there, and it is named with when it broke."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.breakage import parted_at_breakage
from mjx_cutting.trials.dataset import Dataset, Trial

SHARE = 0.6


def _half(early: Trial, late: Trial, share: float) -> Trial:
    """The one trial up to a share of the record, then the other."""
    first = round(share * len(early.time_s))
    return replace(early, force_n=np.concatenate([early.force_n[:first], late.force_n[first:]]))


def _breaking(design: str, share: float = SHARE) -> tuple[Dataset, Trial]:
    """A session in the middle trial of which a tooth breaks, and that trial."""
    whole, broken = (make(design, hidden, seed=401).dataset for hidden in ({}, {"broken_tooth": "strong"}))
    cuts = [each for each in whole.trials if each.kind == "cut"]
    middle = sorted(cuts, key=lambda cut: cut.cut_length_before_m)[len(cuts) // 2]
    trials = []
    for early, late in zip(whole.trials, broken.trials, strict=True):
        if early is middle:
            trials.append(_half(early, late, share))
        else:
            trials.append(early if early.cut_length_before_m < middle.cut_length_before_m else late)
    return replace(whole, trials=tuple(trials)), middle


@pytest.fixture(scope="module", params=["mill", "saw"])
def breaking(request) -> tuple[Dataset, Trial]:
    return _breaking(request.param)


def test_the_trial_is_parted_where_the_tooth_breaks(breaking):
    dataset, middle = breaking
    parted = parted_at_breakage(dataset)
    before, after = (each for each in parted.trials if each.file.startswith(f"{middle.file}, "))
    rest = [each for each in parted.trials if each not in (before, after)]
    assert [each.file for each in rest] == [each.file for each in dataset.trials if each.file != middle.file]
    turn_s = 1.0 / middle.spindle_speed_rev_s
    breaks_s = middle.time_s[0] + SHARE * np.ptp(middle.time_s)
    assert before.time_s[0] == middle.time_s[0] and after.time_s[-1] == middle.time_s[-1]
    assert before.time_s[-1] <= breaks_s <= after.time_s[0]
    assert after.time_s[0] - before.time_s[-1] < 4.0 * turn_s
    fed_m = middle.feed_speed_m_s * (after.time_s[0] - middle.time_s[0])
    assert after.cut_length_before_m == pytest.approx(middle.cut_length_before_m + fed_m, abs=0.01 * fed_m)


def test_what_is_too_short_beside_the_break_is_named_among_what_is_left_out():
    share = 0.94
    dataset, middle = _breaking("saw", share)
    turns = middle.spindle_speed_rev_s * np.ptp(middle.time_s) * (1.0 - share)
    assert 3.0 < turns < 8.0
    parted = parted_at_breakage(dataset)
    names = [each.file for each in parted.trials if each.file.startswith(middle.file)]
    (left_out,) = parted.left_out
    assert [name.startswith(f"{middle.file}, to ") for name in names] == [True]
    assert left_out.file.startswith(f"{middle.file}, from ")
    assert "a tooth breaks" in left_out.reason and "expected 8 or more" in left_out.reason


def test_trials_are_left_whole_where_nothing_breaks_within_one(breaking):
    dataset, middle = breaking
    without = replace(dataset, trials=tuple(each for each in dataset.trials if each.file != middle.file))
    assert parted_at_breakage(without) is without
    unknown = tuple(replace(each, cut_length_before_m=0.0) for each in dataset.trials)
    assert parted_at_breakage(replace(dataset, trials=unknown)).trials == unknown
    for hidden in (
        {},
        {"broken_tooth": "strong"},
        {"radial_runout": "strong"},
        {"regenerative_chatter": "strong"},
    ):
        session = make("mill", hidden, seed=402).dataset
        assert parted_at_breakage(session) is session


@pytest.mark.slow
def test_the_tooth_is_named_with_when_it_broke():
    dataset, middle = _breaking("mill")
    found = trace(dataset, effects=["broken_tooth", "radial_runout", "unequal_pitch"]).verdict
    (tooth,) = found["effects"]
    assert (found["verdict"], tooth["name"]) == ("explained", "broken_tooth")
    assert found["after"]["heldout_nrmse"] < 1.2 * found["noise_floor_nrmse"]
    breaks_m = middle.cut_length_before_m + SHARE * middle.feed_speed_m_s * np.ptp(middle.time_s)
    onset = tooth["parameters"]["onset_m"]
    turn_m = middle.feed_speed_m_s / middle.spindle_speed_rev_s
    assert onset["low"] <= breaks_m <= onset["high"]
    assert onset["high"] - onset["low"] < 4.0 * turn_m
