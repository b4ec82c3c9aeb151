"""The bend of a turning tool's force over its feeds: what three feeds leave open, five tell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.study import make
from benchmarks.study.fewer import FEWER
from mjx_cutting.cutting.effects.size_effect import REFERENCE_M
from mjx_cutting.tracing import trace
from mjx_cutting.trials.dataset import Dataset

TRIED = ("ploughing", "size_effect", "flank_wear")
CHIP_N_M2 = np.array([-0.3e9, 0.6e9, -0.11e9])  # x, y, z of a turning tool: radial, tangential, axial
RATIO = np.array([6.0, 2.5, 2.8])
EXPONENT = np.array([0.42, 0.24, 0.3])
THINNEST_M = 56e-6
FIVE_M = (27e-6, 56e-6, 93e-6, 150e-6, 225e-6)


def ploughed(chip_m: float) -> np.ndarray:
    return RATIO * min(chip_m, THINNEST_M) + max(chip_m - THINNEST_M, 0.0)


def bent_evenly(chip_m: float) -> np.ndarray:
    return chip_m * (chip_m / REFERENCE_M) ** -EXPONENT


def turned(chips_m: tuple[float, ...], law: Callable[[float], np.ndarray]) -> Dataset:
    """A turning session at these chip thicknesses by turns, of this law, with 2 N of noise."""
    dataset = make("turning", {}, 500).dataset
    draw = np.random.default_rng(1)
    cuts = sum(trial.kind == "cut" for trial in dataset.trials)
    chips = iter(np.resize(chips_m, cuts))
    trials = []
    for trial in dataset.trials:
        noise = draw.normal(0.0, 2.0, trial.force_n.shape)
        if trial.kind != "cut":
            trials.append(replace(trial, force_n=noise))
            continue
        chip_m = float(next(chips))
        force = trial.axial_width_m * CHIP_N_M2 * law(chip_m)
        feed = chip_m * trial.spindle_speed_rev_s
        as_cut = replace(trial, force_n=force + noise, feed_speed_m_s=feed, feed_speed_measured_m_s=None)
        trials.append(as_cut)
    sensor = replace(dataset.sensor, noise_std_n=(2.0, 2.0, 2.0))
    return replace(dataset, trials=tuple(trials), sensor=sensor)


def test_an_edge_that_ploughs_at_the_feeds_of_a_lathe_is_named():
    found = trace(turned(FIVE_M, ploughed), effects=TRIED).verdict
    (named,) = found["effects"]
    assert (found["verdict"], named["name"]) == ("explained", "ploughing")
    assert named["parameters"]["minimum_chip_m"]["value"] == pytest.approx(THINNEST_M, rel=0.1)
    np.testing.assert_allclose(named["parameters"]["ratio"]["values"], [2.5, 6.0, 2.8], rtol=0.25)


def test_an_exponent_for_each_direction_is_named_from_five_feeds():
    found = trace(turned(FIVE_M, bent_evenly), effects=TRIED).verdict
    (named,) = found["effects"]
    assert (found["verdict"], named["name"]) == ("explained", "size_effect")
    assert named["parameters"]["exponent"]["value"] == pytest.approx(0.24, rel=0.05)


def test_three_feeds_leave_open_which_of_two_laws_bends_the_force():
    found = trace(turned(FIVE_M[::2], bent_evenly), effects=TRIED).verdict
    assert found["verdict"] == "ambiguous"
    (tied,) = found["ambiguous"]
    assert set(tied["names"]) == {"size_effect", "ploughing"}
    assert "five feeds" in tied["separating_trial"]


def test_ploughing_is_no_finding_of_three_feeds():
    found = trace(turned(FIVE_M[::2], ploughed), effects=TRIED)
    assert found.verdict["effects"] == [] and found.verdict["verdict"] == "unexplained"
    (why,) = next(each for each in found.search.rounds[0].candidates if each.told == 12).decision.reasons
    assert why.startswith("3 feeds show one bend")


def test_a_gain_of_each_trial_is_no_ploughing():
    """Five cuts at three feeds, of which the gain wanders: ploughing follows them to a thousandth."""
    case = make("turning", {"random_walk_gain": "strong"}, 701)
    assert trace(FEWER["five"](case.dataset), seed=701).verdict["effects"] == []


def test_one_exponent_for_all_that_fits_three_feeds_is_no_coincidence():
    found = trace(turned(FIVE_M[::2], lambda chip_m: chip_m * (chip_m / REFERENCE_M) ** -0.2), effects=TRIED)
    (named,) = found.verdict["effects"]
    assert (found.verdict["verdict"], named["name"]) == ("explained", "size_effect")
