"""The noise floor: lines and slow changes beside the noise are no part of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.tracing.records.noise import noise_floor, power_between_lines, white_power

RATE_HZ = 250.0


def test_the_noise_is_what_is_alike_at_all_frequencies():
    time = np.arange(2000) / RATE_HZ
    noise = np.random.default_rng(3).normal(0.0, [1.0, 2.0], (2000, 2))
    seen = noise + 30.0 * np.sin(2.0 * np.pi * 31.0 * time)[:, None] + 50.0 * np.tanh(time - 4.0)[:, None]
    for high, share in ((125.0, 1.0), (60.0, 0.48)):
        power = white_power(seen, RATE_HZ, (0.0, high))
        np.testing.assert_allclose(power, share * np.array([1.0, 4.0]), rtol=0.2)
    np.testing.assert_array_equal(white_power(seen, RATE_HZ, (10.01, 10.05)), 0.0)


def test_the_noise_of_an_air_cut_is_without_an_unbalanced_spindle_and_mains():
    time = np.arange(4000) / RATE_HZ
    noise = np.random.default_rng(4).normal(0.0, [1.0, 2.0], (4000, 2))
    hum = 5.0 * np.sin(2.0 * np.pi * 21.3 * time) + 2.0 * np.sin(2.0 * np.pi * 50.0 * time)
    drift = 4.0 * time / time[-1]
    quiet = power_between_lines(noise, RATE_HZ, (0.0, 125.0))
    np.testing.assert_allclose(quiet, [1.0, 4.0], rtol=0.1)
    heard = power_between_lines(noise + (hum + drift)[:, None], RATE_HZ, (0.0, 125.0))
    np.testing.assert_allclose(heard, quiet, rtol=0.03)


def test_noise_that_is_greater_at_some_frequencies_is_counted_whole():
    noise = np.random.default_rng(6).normal(size=(4002, 1))
    slow = noise[1:-1] + 0.9 * (noise[2:] + noise[:-2])
    assert abs(power_between_lines(slow, RATE_HZ, (0.0, 125.0)) / np.var(slow) - 1.0) < 0.05


@pytest.mark.parametrize("samples", [1, 2, 63, 64, 200])
def test_a_short_record_has_noise_too(samples):
    record = np.random.default_rng(7).normal(size=(samples, 3))
    power = power_between_lines(record, RATE_HZ, (0.0, 125.0))
    np.testing.assert_allclose(power.mean(), np.var(record, axis=0).mean(), rtol=0.6)


def test_a_wave_along_the_sheet_is_no_noise_of_a_sensor_of_which_none_was_stated(mill, posed):
    """Periodic material stands between the lines of the spindle; without a stated noise it must not pass
    for it."""
    made = mill()
    made = replace(made, sensor=replace(made.sensor, noise_std_n=None))
    waved = tuple(
        replace(t, force_n=t.force_n * (1.0 + 0.1 * np.cos(2.0 * np.pi * 5.0 * t.time_s))[:, None])
        for t in made.trials
    )
    with _platform.x64():
        quiet, heard = (noise_floor(each, posed(each)[0]) for each in (made, replace(made, trials=waved)))
    assert heard == pytest.approx(quiet, rel=0.3)


def test_what_a_model_explains_between_the_lines_is_no_noise(mill, posed):
    """A feed that goes in steps leaves force at all frequencies; what a model leaves of it tells."""
    made = mill()
    made = replace(made, sensor=replace(made.sensor, noise_std_n=None))
    generator, stepped, explained = np.random.default_rng(5), [], []
    for trial in made.trials:
        steps = np.repeat(generator.normal(0.0, 0.1, len(trial.time_s) // 50 + 1), 50)[: len(trial.time_s)]
        explained.append(trial.force_n * steps[:, None])
        stepped.append(replace(trial, force_n=trial.force_n + explained[-1]))
    stirred = replace(made, trials=tuple(stepped))
    with _platform.x64():
        quiet, lines = noise_floor(made, posed(made)[0]), posed(stirred)[0]
        left = [now.force_n - more for now, more in zip(stepped, explained, strict=True)]
        told, untold = noise_floor(stirred, lines, left), noise_floor(stirred, lines)
    assert untold > 2.0 * quiet
    assert told == pytest.approx(quiet, rel=0.3)
