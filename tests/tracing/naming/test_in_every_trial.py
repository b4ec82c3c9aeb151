"""An effect that by its law is large in some trials and small in others is no accident of one of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.study import make
from benchmarks.study.fewer import FEWER
from mjx_cutting.cutting.effects.flank_wear import FlankWear
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.naming.in_every_trial import in_every_trial
from mjx_cutting.trials.dataset import Dataset, Trial

TRIED = ("unbalance", "radial_runout")
MOMENT_KG_M = 8e-6


def by_speed(dataset: Dataset, counts: Sequence[int]) -> Dataset:
    """So many of the trials at each spindle speed, the slowest first."""
    cuts: dict[float, list[Trial]] = {}
    for trial in dataset.trials:
        cuts.setdefault(trial.spindle_speed_rev_s, []).append(trial)
    kept = [each for speed, count in zip(sorted(cuts), counts, strict=True) for each in cuts[speed][:count]]
    return replace(dataset, trials=tuple(kept))


@pytest.mark.slow
@pytest.mark.parametrize("counts", [(3, 0, 1), (3, 1, 2)])
def test_few_trials_of_which_the_fast_ones_gain_most_name_an_unbalance(hiding, counts):
    dataset = by_speed(hiding({"unbalance": {"moment_kg_m": MOMENT_KG_M, "phase_rad": 0.7}}, 403), counts)
    found = trace(dataset, effects=TRIED).verdict
    (named,) = found["effects"]
    assert (found["verdict"], named["name"]) == ("explained", "unbalance")
    assert named["heldout_gain"] < 2.0 * named["gain_standard_error"]
    assert named["parameters"]["moment_kg_m"]["value"] == pytest.approx(MOMENT_KG_M, rel=0.05)


@pytest.mark.parametrize("shaken", [0, 3])
def test_what_turns_with_the_spindle_in_one_trial_alone_is_no_unbalance(hiding, shaken):
    dataset = by_speed(hiding({}, 403), (3, 1, 2))
    trials = list(dataset.trials)
    one = trials[shaken]
    angle = 2.0 * np.pi * one.spindle_speed_rev_s * one.time_s
    wave = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    trials[shaken] = replace(one, force_n=one.force_n + 3.0 * wave)
    found = trace(replace(dataset, trials=tuple(trials)), effects=TRIED).verdict
    assert not found["effects"]


@pytest.mark.slow
def test_what_takes_half_of_one_trial_and_most_of_the_others_is_not_in_every_trial():
    """A force that remembers bends with the load as a compliant arm does, not in each trial alike."""
    dataset = FEWER["five"](make("saw", {"previous_force": "strong"}, 700).dataset)
    found = trace(dataset, effects=("static_compliance", "side_friction"), seed=700)
    first = found.search.rounds[0].candidates[0]
    assert first.kind.name == "static_compliance" and first.decision.scattered
    assert found.verdict["effects"] == []


@pytest.fixture
def counted(monkeypatch):
    """Call it with what was left in each trial before and after, squared, in units of the noise."""

    def count(tool: str, before: Sequence[float], after: Sequence[float], by_chance: float) -> bool:
        was, now = (np.sqrt(each)[:, None] for each in (before, after))
        names = in_every_trial.__globals__
        monkeypatch.setitem(names, "_left", lambda problem, lines, effects, _: now if effects else was)
        monkeypatch.setitem(names, "noise_squares", lambda *_: np.zeros((len(was), 1)))
        problem = SimpleNamespace(tool=SimpleNamespace(kind=tool))
        lines = SimpleNamespace(owner=np.arange(len(was)))
        return in_every_trial(problem, lines, (FlankWear,), None, None, 10, by_chance)

    return count


@pytest.mark.parametrize(
    ("left", "by_chance", "counts"), [(0.2, 1e-6, True), (1.5, 1e-6, False), (0.2, 4e-3, False)]
)
def test_of_levels_nearly_all_that_was_left_counts_whichever_trials_it_was_in(
    counted, left, by_chance, counts
):
    """The constants went through two of five levels: there is nothing to gain there."""
    before, after = [9.4, 0.0, 0.0, 2.1, 2.6], [left, 0.0, 0.2, 0.0, 0.0]
    assert counted("turning", before, after, by_chance) is counts


@pytest.mark.parametrize(
    ("others", "by_chance", "counts"),
    [((600.0, 80.0), 0.0, True), ((600.0, 80.0), 1e-3, False), ((2.0, 3.0), 0.0, False)],
    ids=["three gain", "by chance", "one alone gains"],
)
def test_of_lines_nearly_all_that_was_left_counts_if_it_was_in_several_trials(
    counted, others, by_chance, counts
):
    """The constants went through the others, where noise is left."""
    before = [1500.0, *others, 2.0, 1.0, 2.0, 1.5, 8.0]
    after = [2.0, 1.0, 2.5, 1.5, 1.2, 2.0, 1.5, 8.5]
    assert counted("slitting_saw", before, after, by_chance) is counts
