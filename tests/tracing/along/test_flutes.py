"""A drill's flutes that fill: a rise of force from a depth on that is the less the larger the feed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing import predict_trials, trace
from mjx_cutting.tracing.along.flutes import cut_since, rather_a_rise
from mjx_cutting.tracing.records.course import Course
from mjx_cutting.tracing.telling.verdict import not_testable
from mjx_cutting.trials.dataset import Dataset, Trial

TRIED = ["clogging", "layered_material", "material_periodicity", "flank_wear", "size_effect"]
GAIN, CAPACITY_M2 = 0.1, 2e-7


def _times(dataset: Dataset, factor: Callable[[Trial], np.ndarray]) -> Dataset:
    """The trials with force and torque times a factor along each."""
    trials = []
    for each in dataset.trials:
        by = factor(each) if each.kind == "cut" else np.ones(each.samples)
        trials.append(replace(each, force_n=by[:, None] * each.force_n, torque_nm=by * each.torque_nm))
    return replace(dataset, trials=tuple(trials))


def _clogged(trial: Trial, power: float = 1.0) -> np.ndarray:
    chip_m = trial.feed_speed_m_s / (2.0 * trial.spindle_speed_rev_s)
    area = 1e-4 * (chip_m / 1e-4) ** power * trial.feed_speed_m_s * trial.time_s
    return 1.0 + GAIN * np.maximum(area / CAPACITY_M2 - 1.0, 0.0)


@pytest.fixture(scope="module")
def clogged(hiding) -> Dataset:
    return _times(hiding({}, design="drill"), _clogged)


def test_flutes_that_fill_are_named_with_what_they_hold(clogged):
    found = trace(clogged, effects=TRIED)
    verdict = found.verdict
    assert [each["name"] for each in verdict["effects"]] == ["clogging"]
    told = verdict["effects"][0]["parameters"]
    assert told["gain"]["low"] < GAIN < told["gain"]["high"]
    assert told["gain"]["value"] == pytest.approx(GAIN, rel=0.1)
    assert told["capacity_m2"]["value"] == pytest.approx(CAPACITY_M2, rel=0.05)
    assert told["thickness_power"]["value"] == pytest.approx(1.0, abs=0.05)
    assert verdict["after"]["heldout_nrmse"] < 0.2 * verdict["before"]["heldout_nrmse"]
    again = predict_trials(clogged, found.model)
    left = np.sqrt(sum(np.sum(each.residual_n**2) for each in again))
    assert left < 0.2 * np.sqrt(sum(np.sum(each.residual_n**2) for each in found.before))


def test_chips_that_lie_more_loosely_the_thinner_they_are_are_told(hiding):
    found = trace(_times(hiding({}, design="drill"), partial(_clogged, power=0.5)), effects=TRIED)
    assert [each["name"] for each in found.verdict["effects"]] == ["clogging"]
    told = found.verdict["effects"][0]["parameters"]
    assert told["thickness_power"]["value"] == pytest.approx(0.5, abs=0.05)
    assert told["gain"]["value"] == pytest.approx(GAIN, rel=0.1)
    assert found.verdict["after"]["heldout_nrmse"] < 0.2 * found.verdict["before"]["heldout_nrmse"]


@pytest.mark.parametrize(
    "factor",
    [
        lambda trial: 1.0 + 0.2 * np.maximum(trial.time_s - 2.0, 0.0),
        lambda trial: 1.0 + 0.1 * trial.time_s,
        lambda trial: 1.0 + 20.0 * (trial.feed_speed_m_s * trial.time_s - 4e-3),
    ],
)
def test_what_goes_with_time_or_depth_alike_at_every_feed_is_no_clogging(hiding, factor):
    verdict = trace(_times(hiding({}, design="drill"), factor), effects=TRIED).verdict
    assert verdict["verdict"] == "unexplained" and verdict["effects"] == []


@pytest.mark.parametrize("way", ["chip", "time", "depth", "slope"])
def test_a_rise_with_the_chip_cut_is_told_from_one_from_a_time_or_a_depth_on(way):
    """Six holes, one feed each, whose force rises with one or the other."""
    time = np.arange(800) / 200.0
    clogging = effect_class("clogging")(0.6, 1e-6, 1.0)

    def hole(feed: float) -> Course:
        force = np.full((len(time), 3), 100.0)
        bare = Course(time, feed * time, None, force, 0.0 * force, force, 200.0, (0.0, 80.0), pitch_s=0.02)
        area = cut_since(bare) / 1e-6
        over = {"chip": area - 1.0, "time": time - 2.0, "depth": 200.0 * feed * time - 2.0}
        over["slope"] = 200.0 * feed * time
        rise = 0.6 * np.maximum(over[way], 0.0)[:, None] * force
        return replace(bare, left_n=rise + np.random.default_rng(0).normal(size=force.shape))

    holes = [hole(feed) for feed in (3e-3, 4e-3, 5e-3, 6e-3, 7e-3, 8e-3)]
    assert bool(rather_a_rise(holes, clogging)) == (way != "chip")


def test_where_nothing_fills_none_is_named(hiding):
    verdict = trace(hiding({}, design="drill"), effects=["clogging"]).verdict
    assert verdict["verdict"] == "nothing missing"


def test_a_turning_tool_has_no_flutes_and_one_feed_tells_none(hiding, clogged):
    def needed(dataset: Dataset) -> str | None:
        return next((each["needs"] for each in not_testable(dataset) if each["name"] == "clogging"), None)

    assert needed(clogged) is None
    assert needed(hiding({}, design="turning")) == "a cutter whose force changes over a turn"
    first = clogged.trials[0].feed_speed_m_s
    alike = tuple(replace(each, feed_speed_m_s=first) for each in clogged.trials)
    assert needed(replace(clogged, trials=alike)) == "cuts at different feeds, which tell a place from a time"
