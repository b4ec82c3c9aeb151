"""The prediction follows a feed that was measured; a feed held over periods is left to the stair."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing import trace
from mjx_cutting.tracing.along.fed import as_chips_are_cut, as_fed, followed
from mjx_cutting.tracing.records.course import Course
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

RATE_HZ, NOISE_N = 500.0, 0.05
TIME_S = np.arange(1500) / RATE_HZ
WEIGHT = np.full(3, 1.0 / NOISE_N)


def _course(share: Callable, done: Callable, pitch_s: float = 2e-3, seed: int = 0) -> Course:
    """A trial whose measured feed is `share` more than nominal over time, and whose force goes as `done`."""
    chip, noise = np.full((len(TIME_S), 3), 4.0), np.random.default_rng(seed).normal(size=(len(TIME_S), 3))
    left = chip * done(TIME_S)[:, None] + NOISE_N * noise
    zero = np.zeros_like(chip)
    band_hz, feed = (0.0, 200.0), share(TIME_S)
    return Course(TIME_S, 0.01 * TIME_S, feed, chip, zero, left, RATE_HZ, band_hz, pitch_s=pitch_s)


def _ramp(index: int) -> Callable:
    return lambda time: 0.3 * (-1.0) ** index * (2.0 * time / TIME_S[-1] - 1.0)


def _walk(index: int) -> Callable:
    knots = np.arange(0.0, 4.0, 0.05)
    values = np.random.default_rng(index).normal(0.0, 0.1, len(knots))
    return lambda time: np.interp(time, knots, values)


def _held(feed: Callable) -> Callable:
    return lambda time: feed(0.05 * np.floor(time / 0.05 + 1e-6))


@pytest.mark.parametrize("pitch_s", [1e-6, 2e-3, 0.04])
def test_each_tooth_cuts_what_was_fed_since_the_last(pitch_s):
    share = _walk(3)
    fine = np.arange(-0.1, TIME_S[-1], 1e-4) + 5e-5
    fed = np.append(0.0, np.cumsum(share(np.maximum(fine, 0.0)))) * 1e-4
    edges = np.append(fine - 5e-5, fine[-1] + 5e-5)
    expected = (np.interp(TIME_S, edges, fed) - np.interp(TIME_S - pitch_s, edges, fed)) / pitch_s
    seen = followed(_course(share, share, pitch_s))[:, 1] / 4.0
    # between two samples the feed is not known better than to be straight
    np.testing.assert_allclose(seen, expected, atol=0.012)


@pytest.mark.parametrize("feed", [_ramp, _walk])
def test_a_force_that_goes_with_the_measured_feed_is_followed_to_the_noise(feed):
    courses = [_course(feed(i), feed(i), seed=i) for i in range(5)]
    added = as_fed(courses, WEIGHT)
    assert added is not None
    for course, wave in zip(courses, added, strict=True):
        assert np.std(course.left_n - wave) == pytest.approx(NOISE_N, rel=0.05)
        assert np.std(course.left_n) > 5.0 * NOISE_N


def test_a_feed_that_was_measured_in_some_trials_is_followed_there():
    known = [_course(_ramp(i), _ramp(i), seed=i) for i in range(2)]
    rest = [_course(_ramp(i), lambda time: 0.0 * time, seed=i) for i in range(2, 5)]
    added = as_fed([*known, *(replace(each, feed_share=None) for each in rest)], WEIGHT)
    assert added is not None
    assert all(
        np.std(each.left_n - wave) < 1.05 * NOISE_N for each, wave in zip(known, added[:2], strict=True)
    )
    assert not np.any(added[2:])


def test_a_spindle_that_slows_down_cuts_more_with_every_tooth():
    for feed in (None, _walk):
        courses = []
        for index in range(5):
            later, fed = _ramp(index), (lambda time: 0.0 * time) if feed is None else feed(index)
            course = _course(
                fed, lambda time, fed=fed, later=later: (1.0 + fed(time)) * (1.0 + later(time)) - 1.0
            )
            share = None if feed is None else course.feed_share
            courses.append(replace(course, feed_share=share, later=later(TIME_S), pitch_s=1e-6))
        added = as_fed(courses, WEIGHT)
        assert added is not None
        for course, wave in zip(courses, added, strict=True):
            assert np.std(course.left_n - wave) == pytest.approx(NOISE_N, rel=0.05)


def test_what_was_held_over_periods_is_left_to_the_stair():
    held = [_held(_walk(index)) for index in range(5)]
    measured_smooth = [_course(_walk(i), held[i], seed=i) for i in range(5)]
    measured_held = [_course(held[i], held[i], seed=i) for i in range(5)]
    assert as_fed(measured_smooth, WEIGHT) is None
    assert as_fed(measured_held, WEIGHT) is None


@pytest.mark.parametrize("done", [lambda feed: feed, _held])
def test_a_force_of_the_feed_of_the_instant_is_told_from_one_of_the_last_chip(done):
    """Of teeth 40 ms apart, whether the feed is followed or held over periods."""
    fine = np.arange(-0.2, TIME_S[-1], 1e-4) + 5e-5

    def chip(feed: Callable) -> Callable:
        fed = np.append(0.0, np.cumsum(feed(np.maximum(fine, 0.0)))) * 1e-4
        edges = np.append(fine - 5e-5, fine[-1] + 5e-5)
        return lambda time: (np.interp(time, edges, fed) - np.interp(time - 0.04, edges, fed)) / 0.04

    feeds = [_walk(index) for index in range(5)]
    instant = [_course(each, done(each), 0.04, seed=i) for i, each in enumerate(feeds)]
    last = [_course(each, chip(done(each)), 0.04, seed=i) for i, each in enumerate(feeds)]
    assert all(not each.by_tooth for each in as_chips_are_cut(instant, WEIGHT))
    assert all(each.by_tooth for each in as_chips_are_cut(last, WEIGHT))
    assert all(
        each.by_tooth
        for each in as_chips_are_cut([_course(_walk(i), _walk(i + 50), 0.04) for i in range(5)], WEIGHT)
    )


def test_a_force_that_does_not_go_with_the_feed_is_left_alone():
    assert as_fed([_course(_walk(i), _walk(i + 50), seed=i) for i in range(5)], WEIGHT) is None
    assert as_fed([_course(_ramp(i), lambda time: 0.0 * time, seed=i) for i in range(5)], WEIGHT) is None


def _turned(gain: Callable = lambda time, index: 1.0) -> Dataset:
    """Six cuts with a turning tool, half of them at a feed that doubles; the force times `gain`."""
    trials = []
    for index, speed in enumerate((8.0, 8.0, 8.0, 16.0, 16.0, 16.0)):
        middle = speed * (1e-4, 2e-4, 3e-4)[index % 3]
        feed = middle * (1.0 + (_ramp(index)(TIME_S) if index % 2 else 0.0 * TIME_S))
        chip = np.array([-4e8, 2e9, -6e8]) * 1e-3 * (feed / speed)[:, None]
        noise = np.random.default_rng(index).normal(size=(len(TIME_S), 3))
        edge = 1e-3 * np.array([-3e4, 5e4, -4e4])
        force = (chip + edge) * np.broadcast_to(gain(TIME_S, index), TIME_S.shape)[:, None] + noise
        place = np.cumsum(feed) / RATE_HZ
        trials.append(
            Trial(
                file=f"{index}.csv",
                kind="cut",
                milling=None,
                spindle_speed_rev_s=speed,
                feed_speed_m_s=middle,
                radial_depth_m=1e-3,
                axial_width_m=1e-3,
                time_s=TIME_S,
                force_n=force,
                position_m=np.stack([place, 0.0 * place, 0.0 * place], axis=1),
                feed_speed_measured_m_s=feed,
            )
        )
    tool, sensor = ToolInfo("turning", 1, 0.05), Sensor(RATE_HZ, (1.0, 1.0, 1.0), zeroed="trial")
    told = {"name": "bar", "source": "made by calculation", "licence": "Apache-2.0"}
    return Dataset(**told, tool=tool, sensor=sensor, trials=tuple(trials))


def test_a_feed_that_changes_as_it_was_measured_is_nothing_missing():
    verdict = trace(_turned(), effects=("command_stair", "layered_material")).verdict
    assert verdict["verdict"] == "nothing missing" and verdict["effects"] == []
    assert verdict["before"]["heldout_nrmse"] < 1.1 * verdict["noise_floor_nrmse"]


def test_beside_something_else_it_is_not_called_a_stair():
    """A gain that falls and jumps back, as a built-up edge on the tool makes it."""

    def gain(time, index):
        starts = np.sort(np.random.default_rng(10 + index).uniform(0.0, 3.0, 6))
        since = time - np.append(0.0, starts)[np.searchsorted(starts, time)]
        return 1.0 - 0.3 * np.minimum(since, 1.0)

    verdict = trace(_turned(gain), effects=("command_stair", "layered_material")).verdict
    assert verdict["verdict"] == "unexplained" and verdict["effects"] == []
