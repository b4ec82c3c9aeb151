"""Trials shifted and warped by known amounts, put back; measured coordinates; the report; bad input."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import signal

from mjx_cutting.trials import align_figure
from mjx_cutting.trials.align import align, align_measured, align_trials, medoid
from mjx_cutting.trials.dataset import Trial
from mjx_cutting.trials.resampling import coarse_lags, dominant_period, interpolate, reindex

RATE = 100.0


def _wave(t):
    """A transient on a periodic force of period 0.5 s, so that lags are not known modulo the period only."""
    cycle = np.sin(2 * np.pi * t / 0.5) + 0.4 * np.cos(4 * np.pi * t / 0.5)
    rise = 1.0 / (1.0 + np.exp(-(t - 0.8) / 0.1))
    return np.stack([rise * (3.0 + cycle), rise * (1.0 - 2.0 * cycle), 0.3 * cycle + rise], -1)


def _shifted(lags, noise=0.05, seconds=4.0, seed=0):
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE)) / RATE
    return [_wave(t - lag) + noise * rng.normal(size=(len(t), 3)) for lag in lags]


def test_lags_are_found_to_a_fraction_of_a_sample():
    lags = np.array([0.0, 0.113, -0.2071, 0.055])
    found = align(_shifted(lags, noise=0.02), RATE, warp=False)
    relative = found.lag_s - found.lag_s[0]
    np.testing.assert_allclose(relative, lags, atol=0.1 / RATE)
    report = found.report()
    assert report["spread_after"] == report["spread_shifted"] < 0.05 < 0.2 * report["spread_before"]
    assert report["warp_max_s"] == 0.0 and report["variable"] == "time"


def test_shift_is_applied_to_other_series_in_their_own_unit():
    lags = [0.0, 0.25]
    found = align(_shifted(lags), RATE, warp=False)
    ramp = [np.arange(400.0)[:, None], np.arange(400.0)[:, None]]
    placed = found.apply(ramp)
    both = np.isfinite(placed).all((0, 2))
    inner = placed[:, both][:, 20:-20, 0]
    np.testing.assert_allclose(inner[1] - inner[0], 25.0, atol=0.15)
    with pytest.raises(ValueError, match="one for each of 2"):
        found.apply(ramp[:1])


def test_a_smooth_warp_is_undone_and_the_report_says_how_much():
    t = np.arange(400) / RATE
    bend = 0.06 * np.sin(np.pi * t / t[-1]) ** 2
    series = [_wave(t), _wave(t + bend), _wave(t - bend)]
    found = align(series, RATE)
    report = found.report()
    assert report["spread_after"] < 0.35 * report["spread_shifted"]
    assert 0.02 < report["warp_rms_s"] < 0.06 and report["warp_max_s"] < 0.12
    assert report["reference"] == found.reference == 0
    np.testing.assert_allclose(report["period_after_s"], 0.5, rtol=0.02)
    assert found.distance.shape == (3, 3) and found.distance[1, 0] != found.distance[0, 1]


def test_the_bound_on_the_warp_holds():
    found = align(_shifted([0.0, 0.02, -0.03], noise=0.5), RATE, warp_radius_s=0.03)
    assert found.report()["warp_max_s"] <= 0.03 + 1e-9
    tighter = align(_shifted([0.0, 0.02, -0.03], noise=0.5), RATE)
    assert tighter.report()["warp_max_s"] > 0.03


def test_different_lengths_leave_gaps_not_inventions():
    series = _shifted([0.0, 0.1, 0.05])
    series[1] = series[1][:300]
    found = align(series, RATE, warp_radius_s=0.1)
    assert found.reference != 1
    covered = np.isfinite(found.after).all(-1).mean(1)
    assert covered[1] < 0.85 and covered[found.reference] == 1.0
    assert found.apply(series).shape == found.after.shape
    np.testing.assert_allclose(found.apply(series), found.after)
    np.testing.assert_allclose(found.apply(series, warp=False), found.shifted)
    np.testing.assert_array_equal(found.before[1, :300], series[1])


def test_standardisation_is_kept_and_is_undone():
    series = _shifted([0.0, 0.0], noise=0.1)
    found = align(series, RATE, warp=False)
    for r in range(2):
        np.testing.assert_allclose(found.mean[r], series[r].mean(0))
        np.testing.assert_allclose(found.deviation[r], series[r].std(0))
    # scale and offset of a channel do not move the alignment
    other = align([1000.0 * s + 5.0 for s in series], RATE, warp=False)
    np.testing.assert_allclose(other.lag_s, found.lag_s, atol=1e-12)


def test_one_trial_and_a_constant_channel():
    one = align(_shifted([0.0])[:1], RATE)
    assert one.reference == 0 and one.after.shape == (1, 400, 3)
    series = _shifted([0.0, 0.1])
    for s in series:
        s[:, 2] = 4.0
    found = align(series, RATE, warp=False)
    assert np.isfinite(found.lag_s).all() and found.deviation[0, 2] == 1.0


def _trial(force, **measured):
    time = np.arange(len(force)) / RATE
    return Trial(
        file=f"t{len(force)}.csv", kind="cut", milling="slot", spindle_speed_rev_s=2.0, feed_speed_m_s=0.01,
        radial_depth_m=0.02, axial_width_m=0.001, time_s=time, force_n=force, **measured,
    )  # fmt: skip


def test_spindle_angle_is_used_where_measured_and_said_so():
    t = np.arange(400) / RATE
    trials, angles = [], []
    for speed, start in ((2.0, 0.3), (2.05, 7.0), (1.96, 5.9)):
        angle = start + 2 * np.pi * speed * t + 0.05 * np.sin(3 * t)
        force = np.stack([np.sin(angle), np.cos(angle), np.sin(2 * angle)], -1)
        trials.append(_trial(force, spindle_angle_rad=np.mod(angle, 2 * np.pi)))
        angles.append(angle)
    found = align_trials(trials, RATE)
    report = found.report()
    assert found.variable == "spindle_angle" and "measured" in found.reason and found.reference == -1
    assert report["spread_after"] < 0.02 < report["spread_before"]
    assert report["period_after_s"] == pytest.approx(1 / np.mean([2.0, 2.05, 1.96]), rel=0.02)
    by_time = align_trials(trials, RATE, variable="time", warp=False)
    assert by_time.variable == "time"


def test_position_is_used_where_measured_else_the_reason_is_given():
    t = np.arange(400) / RATE
    trials = []
    for start in (0.0, 0.004):
        along = start + 0.01 * t
        force = np.stack([np.sin(2 * np.pi * along / 0.005)] * 3, -1)
        position = np.stack([0.5 * np.ones_like(t), -along, np.zeros_like(t)], -1)
        trials.append(_trial(force, position_m=position))
    found = align_trials(trials, RATE)
    assert found.variable == "position"
    assert found.report()["spread_after"] < 0.01
    assert found.report()["period_after_s"] == pytest.approx(0.5, rel=0.02)  # 5 mm at 10 mm/s
    mixed = [trials[0], dataclasses.replace(trials[1], position_m=None)]
    said = align_trials(mixed, RATE, warp=False)
    assert said.variable == "time"
    assert "spindle angle" in said.reason and "position" in said.reason
    with pytest.raises(ValueError, match="not all trials measured the position"):
        align_trials(mixed, RATE, variable="position")


def test_the_figure_is_a_picture(tmp_path):
    found = align(_shifted([0.0, 0.1, 0.05]), RATE, warp_radius_s=0.05)
    path = align_figure.save(found, tmp_path / "alignment.png")
    assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    figure = align_figure.draw(found)
    titles = [a.get_title() for a in figure.axes if a.get_title()]
    assert titles == ["before, each on its own clock", "shifted", "after, shifted and warped in time"]
    assert all("(N)" in a.get_ylabel() for a in figure.axes[::3])
    assert len(align_figure.draw(align(_shifted([0.0, 0.1]), RATE, warp=False)).axes) == 6


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: align([], RATE), "got 0 trials"),
        (lambda s: align(s, 0.0), "sample rate"),
        (lambda s: align([s[0], s[1][:, :2]], RATE), "same channels"),
        (
            lambda s: align([s[0], np.where(np.arange(400)[:, None] == 7, np.nan, s[1])], RATE),
            "trial 1.*sample 7",
        ),
        (lambda s: medoid([[0, np.inf], [np.inf, 0]]), "larger radius"),
        (lambda s: align_trials([], RATE), "no trial"),
        (lambda s: align_trials([_trial(s[0])], RATE, variable="phase"), "'phase'"),
        (lambda s: align_measured(s, [np.arange(400.0), -np.arange(400.0)], RATE, "position"), "trial 1"),
        (
            lambda s: align_measured(s, [np.arange(400.0), 900 + np.arange(400.0)], RATE, "position"),
            "overlap",
        ),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call(_shifted([0.0, 0.1]))


def test_medoid_and_reindex_by_hand():
    assert medoid([[0, 1, 9], [1, 0, 2], [9, 2, 0]]) == 1
    placed = np.array([[1.0], [3.0], [10.0]])
    matches = np.array([[0, 0], [1, 0], [2, 1], [2, 2]])
    np.testing.assert_array_equal(reindex(placed, matches, 4)[:, 0], [2.0, 10.0, 10.0, np.nan])


def test_interpolation_keeps_waves_and_the_variance_of_noise():
    t = np.arange(500.0)
    at = t[20:-20] + 0.37
    smooth = np.sin(2 * np.pi * t / 9.0)[:, None]
    np.testing.assert_allclose(interpolate(smooth, at)[:, 0], np.sin(2 * np.pi * at / 9.0), atol=5e-3)
    noise = np.random.default_rng(0).normal(size=(20000, 1))
    assert interpolate(noise, np.arange(20, 19980) + 0.5).std() == pytest.approx(1.0, abs=0.05)
    np.testing.assert_allclose(interpolate(smooth, t[10:20])[:, 0], smooth[10:20, 0], atol=1e-12)


def test_lags_agree_with_scipys_and_are_antisymmetric():
    rng = np.random.default_rng(3)
    base = signal.lfilter([1.0], [1.0, -0.9], rng.normal(size=600))
    x, y = base[50:500, None], base[38:488, None]
    lags = coarse_lags([x, y], 40)
    assert abs(lags[1] - lags[0]) == pytest.approx(12, abs=0.3)
    assert lags[1] - lags[0] > 0  # y shows the same event later


def test_dominant_period_between_the_bins_and_too_short():
    t = np.arange(300) / RATE
    values = np.stack([np.sin(2 * np.pi * t / 0.317), np.cos(2 * np.pi * t / 0.317)], -1)[None]
    assert dominant_period(values, 1 / RATE) == pytest.approx(0.317, rel=2e-3)
    assert np.isnan(dominant_period(values[:, :3], 1 / RATE))
