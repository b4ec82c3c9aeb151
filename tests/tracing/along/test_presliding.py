"""Friction of the drive that builds up with the way is found; what takes the same time is not called that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting.cutting.effects.hysteresis import strained as of_the_effect
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.along.presliding import HYSTERESIS, strain
from mjx_cutting.tracing.along.presliding import strained as along_way
from mjx_cutting.tracing.along.slow import search_slow
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.records.course import Course

RATE_HZ, SECONDS, NOISE_N = 500.0, 4.0, 0.2
PRESLIDING_M = 1e-3
FEEDS_M_S = (0.002, 0.003, 0.005, 0.008, 0.012, 0.02)


def _rounds(drag, delay_s: float = 0.0, feeds=FEEDS_M_S):
    """The rounds on cuts with `drag` (time, way, feed) [T] against the feed, N, felt `delay_s` late."""
    courses, error = [], []
    time = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    for index, feed in enumerate(feeds):
        generator = np.random.default_rng(index)
        since = np.maximum(time - delay_s, 0.0)
        chip = (1.0 + 0.5 * np.cos(2 * np.pi * 80.0 * time + index))[:, None] * np.array([3.0, 5.0, 1.0])
        left = NOISE_N * generator.normal(size=chip.shape)
        left[:, 0] -= drag(since, feed * since, feed)
        course = Course(
            time, feed * (time - delay_s), None, chip, np.full_like(chip, 2.0), left, RATE_HZ, (0.0, 200.0)
        )
        course = replace(course, delay_s=delay_s, left_n=course.own(left[..., None])[..., 0])
        courses.append(course)
        error.append(np.sum(course.left_n**2, axis=0))
    before = HeldOut(np.stack(error), np.full((len(feeds), 3), 1e5), None, np.arange(len(feeds)))
    return search_slow(courses, before, np.full(3, 1.0 / NOISE_N), kinds=(HYSTERESIS,))


@pytest.mark.parametrize("delay_s", [0.0, 0.02])
def test_presliding_is_found_with_its_way_and_its_force(delay_s):
    """Also behind a filter, by whose delay the beginning is felt later."""
    (first, *_) = _rounds(lambda t, s, v: 5.0 * (1.0 - np.exp(-s / 2e-3)), delay_s)
    assert first.accepted is not None
    values = first.accepted.effect.values()
    assert values["coulomb_n"] == pytest.approx(5.0, rel=0.03)
    assert values["presliding_m"] == pytest.approx(2e-3, rel=0.03)
    told = first.accepted.decision.parameters
    assert told["coulomb_n"].low < 5.0 < told["coulomb_n"].high
    assert told["presliding_m"].low < 2e-3 < told["presliding_m"].high


def test_what_the_trials_do_not_tell_is_said_to_be_unknown():
    """The zero of every trial is free, and with it what grows with the feed."""
    (first, *_) = _rounds(lambda t, s, v: 5.0 * (1.0 - np.exp(-s / 2e-3)) + 100.0 * v)
    assert first.accepted is not None
    told, declared = first.accepted.decision.parameters, first.accepted.kind.parameters
    for name in ("viscous_n_s_m", "stiction", "beta"):
        assert (told[name].low, told[name].high) == (declared[name].low, declared[name].high)


def test_what_settles_in_time_is_no_friction():
    (first,) = _rounds(lambda t, s, v: 5.0 * (1.0 - np.exp(-t / 0.3)))
    assert first.accepted is None
    assert any("same time at every feed" in why for why in first.candidates[0].decision.reasons)


def test_at_one_feed_it_is_not_looked_for():
    assert _rounds(lambda t, s, v: 5.0 * (1.0 - np.exp(-s / 2e-3)), feeds=(0.005,) * 6) == ()


@pytest.mark.slow
def test_a_session_with_hysteresis_is_explained():
    case = make("mill", {"hysteresis": "medium"}, 405)
    others = ("static_compliance", "entry_exit", "layered_material", "sensor_lowpass", "radial_runout")
    verdict = trace(case.dataset, effects=("hysteresis", *others)).verdict
    assert [each["name"] for each in verdict["effects"]] == ["hysteresis"]
    found, truth = verdict["effects"][0]["parameters"], case.truth["effects"]["hysteresis"]
    assert found["presliding_m"]["value"] == pytest.approx(truth["presliding_m"], rel=0.02)
    assert found["coulomb_n"]["low"] < truth["coulomb_n"] < found["coulomb_n"]["high"]
    assert verdict["after"]["heldout_nrmse"] < 1.1 * verdict["noise_floor_nrmse"]


def test_where_a_trial_turns_back_the_contacts_are_strained_the_other_way(strained):
    """Against small steps along a way back, forth and back again, with what a position sensor jitters."""
    way_m = np.concatenate(
        [np.linspace(0, -4e-3, 300), np.linspace(-4e-3, 2e-2, 900), np.linspace(2e-2, 1.5e-2, 200)]
    )
    expected = strained(way_m, PRESLIDING_M)
    jitter = 2e-6 * np.random.default_rng(0).normal(size=len(way_m))
    nothing = np.zeros((len(way_m), 3))
    time_s = np.arange(len(way_m)) / RATE_HZ
    course = Course(time_s, way_m + jitter, None, nothing, nothing, nothing, RATE_HZ, (0.0, 200.0))
    assert course.legs.forth.tolist() == [-1.0, 1.0, -1.0]
    np.testing.assert_allclose(strain(course, PRESLIDING_M), expected, atol=0.02)


BETA = 0.6


def _across(force, seed: int = 0, noise_m: float = 2e-6):
    """The rounds on cuts at one feed in which a drive moves the tool across the path too, 0.7 mm to either
    side, before the record begins as well: `force` (way [T], time [T]) along y, N."""
    courses, error = [], []
    whole = np.arange(-int(RATE_HZ), int(RATE_HZ * SECONDS)) / RATE_HZ
    inside = whole >= 0.0
    for index in range(6):
        generator = np.random.default_rng([seed, index])
        start, turns_s = generator.uniform(0.0, 6.0), generator.uniform(0.3, 0.9)
        way_m = 7e-4 * np.sin(2.0 * np.pi * turns_s * whole + start)
        left = NOISE_N * generator.normal(size=(int(inside.sum()), 3))
        left[:, 1] += force(way_m, whole)[inside]
        chip = np.ones_like(left) * np.cos(2.0 * np.pi * 80.0 * whole[inside] + index)[:, None]
        seen = way_m[inside] + noise_m * generator.normal(size=len(left))
        still = np.full_like(chip, 2.0)
        course = Course(
            whole[inside], 0.01 * whole[inside], None, chip, still, left, RATE_HZ, (0.0, 200.0), beside_m=seen
        )
        course = replace(course, left_n=course.own(left[..., None])[..., 0])
        courses.append(course)
        error.append(np.sum(course.left_n**2, axis=0))
    before = HeldOut(np.stack(error), np.full((6, 3), 1e5), None, np.arange(6))
    return search_slow(courses, before, np.full(3, 1.0 / NOISE_N), kinds=(HYSTERESIS,))


def _bouc_wen(way_m, presliding_m: float, beta: float):
    """Strain by small steps of Bouc and Wen's law."""
    strain, last = np.zeros(len(way_m)), 0.0
    for index, step in enumerate(np.diff(way_m) / (20.0 * presliding_m)):
        for _ in range(20):
            last += step - beta * abs(step) * last - (1.0 - beta) * step * abs(last)
        strain[index + 1] = last
    return strain


@pytest.mark.parametrize("beta", [1.0, BETA])
def test_friction_across_the_path_is_found_by_its_loop(beta):
    """Whatever the strain of the contacts as the record begins; the way that the loop has, too."""
    (first, *_) = _across(lambda way, time: -4.0 * _bouc_wen(way, 2e-4, beta))
    assert first.accepted is not None
    values = first.accepted.effect.values()
    assert values["across"] == 1.0
    assert values["coulomb_n"] == pytest.approx(4.0, rel=0.04)
    assert values["presliding_m"] == pytest.approx(2e-4, rel=0.06)
    assert values["beta"] == pytest.approx(beta, abs=0.06)
    assert first.accepted.heldout.nrmse < 0.2 * first.before.nrmse


def test_a_spring_across_the_path_is_no_friction():
    """Its force goes with the place and has no loop."""
    (first,) = _across(lambda way, time: -6e3 * way)
    assert first.accepted is None


def test_what_noise_leaves_across_the_path_is_not_named():
    (first,) = _across(lambda way, time: 0.0 * way)
    assert first.accepted is None


def test_strain_is_that_of_the_effect():
    """Of the effect's own law over any way, at any strain it starts from."""
    last, gone = np.meshgrid(np.linspace(-1.0, 1.0, 9), np.linspace(0.0, 4.0, 9))
    for beta in (0.5, 0.65, 1.0):
        np.testing.assert_allclose(along_way(last, gone, beta), of_the_effect(last, gone, beta), atol=1e-5)
