"""Two files that changed places are told, and their records traced under their own conditions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing import trace
from mjx_cutting.tracing.exchanged import Exchange, exchanged, two_unlike
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.trials.synthetic import Hidden

CHANGED = Exchange("t02.csv", "t05.csv")


def _left(error) -> HeldOut:
    """Squared error of six trials, N^2, of as much force each."""
    return HeldOut(np.outer(error, np.ones(3)), 1e3 * np.ones((6, 3)), None, np.arange(6))


@pytest.mark.parametrize(
    ("hidden", "verdict", "named"),
    [(Hidden(), "nothing missing", []), (Hidden(runout_m=1e-5), "explained", ["radial_runout"])],
    ids=["nothing hidden", "runout"],
)
def test_files_that_changed_places_are_told(mill, hidden, verdict, named):
    found = trace(exchanged(mill(hidden), CHANGED), effects=["radial_runout", "size_effect"])
    assert found.verdict["verdict"] == verdict
    assert [each["name"] for each in found.verdict["effects"]] == named
    assert not found.verdict["left_out"]
    assert any(said.startswith("t02.csv and t05.csv:") for said in found.caveats)


def test_an_exchange_keeps_every_record_with_its_file(mill):
    dataset = mill()
    other = exchanged(dataset, CHANGED)
    conditions = {trial.file: trial.feed_speed_m_s for trial in dataset.trials}
    assert conditions["t02.csv"] != conditions["t05.csv"]
    for was, now in zip(dataset.trials, other.trials, strict=True):
        assert now.file == was.file and np.array_equal(now.force_n, was.force_n)
    assert {trial.file: trial.feed_speed_m_s for trial in other.trials} == conditions | {
        "t02.csv": conditions["t05.csv"],
        "t05.csv": conditions["t02.csv"],
    }


@pytest.mark.parametrize(
    ("error", "pair"),
    [
        ([1.0, 40.0, 1.0, 1.0, 30.0, 1.0], CHANGED),
        ([1.0, 40.0, 1.0, 1.0, 1.5, 1.0], None),
        ([9.0, 30.0, 9.0, 9.0, 30.0, 9.0], None),
        ([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], None),
    ],
    ids=["two", "one", "not most of it", "all"],
)
def test_two_trials_are_looked_at_where_they_hold_most_of_what_is_left(mill, error, pair):
    dataset = mill()
    assert two_unlike(dataset, dataset, [_left([1.0] * 6), _left(error)], 0.0) == pair


def test_two_trials_under_the_same_conditions_have_nothing_to_exchange(mill):
    dataset = mill()
    first, second, *rest = dataset.trials
    again = replace(first, file=second.file, time_s=second.time_s, force_n=second.force_n)
    alike = replace(dataset, trials=(first, again, *rest))
    left = [_left([40.0, 30.0, 1.0, 1.0, 1.0, 1.0])]
    assert two_unlike(alike, alike, left, 0.0) is None
    assert two_unlike(dataset, dataset, left, 0.0) == Exchange(first.file, second.file)


def test_parts_of_a_trial_that_broke_are_no_files(mill):
    dataset = mill()
    first, *rest = dataset.trials
    parts = replace(dataset, trials=(replace(first, file=f"{first.file}, until 0.2 s"), *rest))
    left = [_left([40.0, 30.0, 1.0, 1.0, 1.0, 1.0])]
    assert two_unlike(dataset, parts, left, 0.0) is None
