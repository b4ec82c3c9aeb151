"""Compressing a record to lines loses nothing that a steady model could explain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing.records.lines import band_limit, basis, compress, trusted_band


def test_energy_is_lines_plus_rest(mill):
    lines = compress(mill(), (0.0, 1000.0))
    total = (lines.whitened**2).sum(axis=1) + lines.rest_n2
    np.testing.assert_allclose(total, lines.energy_n2, rtol=1e-9)


def test_a_short_record_without_a_filter_has_as_many_lines_as_it_tells_apart(saw):
    """A piece of a trial, say: of a filtered one the highest lines are not heard."""
    made = saw()
    trials = tuple(replace(t, time_s=t.time_s[:460], force_n=t.force_n[:460]) for t in made.trials)
    sensor = replace(made.sensor, anti_alias=None)
    lines = compress(replace(made, sensor=sensor, trials=trials), (0.0, 250.0))
    assert 2 * lines.present.sum(axis=1).max() < 460
    assert lines.orders >= made.tool.teeth


def test_squared_error_of_any_coefficients(mill):
    dataset = mill()
    lines = compress(dataset, (0.0, 1000.0))
    generator = np.random.default_rng(1)
    coefficients = generator.normal(size=(2 * lines.orders + 1, 3)) * lines.present[0][:, None]
    trial = dataset.trials[0]
    columns = basis(2 * np.pi * lines.speed_rev_s[0] * trial.time_s, lines.orders)
    columns = band_limit(columns, 5000.0, (0.0, 1000.0))
    record = band_limit(trial.force_n, 5000.0, (0.0, 1000.0))
    direct = np.sum((record - columns @ coefficients) ** 2)
    compressed = np.sum((lines.whitened[0] - lines.factor[0].T @ coefficients) ** 2) + lines.rest_n2[0].sum()
    assert compressed == pytest.approx(direct, rel=1e-6)


def test_what_lies_between_the_lines_is_the_noise(mill):
    noise = compress(mill(), (0.0, 1000.0)).noise_std_n()
    # the band holds 1000 of the 2500 Hz over which the sensor's noise is spread; the ideal filter's
    # ringing at the ends of a record that is no whole number of turns adds to it
    expected = np.sqrt(1000 / 2500) * np.array([0.5, 0.5, 1.0])
    assert np.all(noise > 0.9 * expected)
    assert np.all(noise < 1.4 * expected)


def test_band_limit_keeps_the_mean_and_what_is_inside():
    time = np.arange(1000) / 1000.0
    inside, outside = 3 + np.cos(2 * np.pi * 20 * time), np.cos(2 * np.pi * 200 * time)
    kept = band_limit(np.stack([inside + outside] * 3, axis=1), 1000.0, (0.0, 100.0))
    np.testing.assert_allclose(kept[:, 0], inside, atol=1e-12)


def test_orders_far_outside_the_band_are_left_out(mill):
    lines = compress(mill(), (0.0, 130.0))
    # one and a half spindle orders beside the band leak into it and are kept
    highest = [present[1::2].sum() for present in lines.present]
    assert highest == [4, 4, 4, 3, 3, 3]


def test_default_band_is_the_filters_corner(saw, mill):
    assert trusted_band(saw(), None) == (0.0, 200.0)
    assert trusted_band(mill(), None) == (0.0, 1000.0)


@pytest.mark.parametrize("band", [(10.0, 5.0), (-1.0, 10.0), (0.0, 4000.0)])
def test_a_band_that_cannot_be_is_refused(mill, band):
    with pytest.raises(ValueError, match="half the sampling rate"):
        trusted_band(mill(), band)


def test_without_a_filter_lines_are_followed_as_far_as_the_record_tells_them_apart(saw):
    """A line at ten times half the sampling rate is heard where it folds; behind a filter it is not."""
    made, order = saw(), 140
    bare = replace(made, sensor=replace(made.sensor, anti_alias=None))
    samples = len(made.trials[0].time_s)
    speeds = compress(made, (0.0, 200.0)).speed_rev_s
    beyond = [
        replace(trial, force_n=trial.force_n + np.cos(2.0 * np.pi * order * speed * trial.time_s)[:, None])
        for trial, speed in zip(bare.trials, speeds, strict=True)
    ]
    followed = compress(replace(bare, trials=tuple(beyond)), (0.0, 250.0), about_rev_s=speeds).followed
    assert followed[order] and len(followed) - 1 <= samples / 8
    behind = compress(replace(made, trials=tuple(beyond)), (0.0, 200.0), about_rev_s=speeds).followed
    assert len(behind) <= order or not behind[order]
