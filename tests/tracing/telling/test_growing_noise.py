"""Noise that grows with the force is noise; what else is left where the force is large is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.telling.growing_noise import growing_noise

RATE_HZ, BAND = 2000.0, (0.0, 800.0)


def left(noise, trials: int = 4, steady_n: float = 0.0) -> list[Prediction]:
    """Trials of a force in pulses, twenty a second, on a steady one, and the `noise(generator, force)`."""
    generator = np.random.default_rng(1)
    found = []
    for index in range(trials):
        time = np.arange(3000) / RATE_HZ
        pulse = np.maximum(np.sin(2.0 * np.pi * 20.0 * time + index), 0.0)
        force = (30.0 * pulse[:, None] + steady_n) * np.array([1.0, 2.0, 0.5])
        bias = np.array([1.0, -2.0, 0.5])
        measured = force + bias + noise(generator, force)
        found.append(Prediction(f"t{index}", time, time, measured, force + bias, 20.0, bias))
    return found


def white(generator, force):
    return generator.normal(size=force.shape)


def growing(generator, force):
    return (0.2 + 0.05 * np.abs(force)) * white(generator, force)


def test_noise_that_grows_is_told_with_its_size():
    trials = left(growing)
    squares = sum(float(np.sum(each.residual_n**2)) for each in trials)
    force = sum(float(np.sum((each.predicted_n - each.bias_n) ** 2)) for each in trials)
    assert growing_noise(trials, RATE_HZ, BAND) == pytest.approx(np.sqrt(squares / force))


def slow(generator, force):
    """A gain that wanders within a tenth of a second."""
    gain = np.convolve(generator.normal(size=len(force) + 199), np.ones(200) / 200**0.5, "valid")
    return 0.05 * gain[:, None] * force + 0.2 * white(generator, force)


def spikes(generator, force):
    return (0.2 + 0.8 * np.abs(force) * (generator.random(force.shape) < 0.01)) * white(generator, force)


def periodic(generator, force):
    return 0.05 * force + 0.2 * white(generator, force)


@pytest.mark.parametrize("noise", [white, slow, spikes, periodic])
def test_what_is_no_noise_that_grows(noise):
    assert growing_noise(left(noise), RATE_HZ, BAND) is None


@pytest.mark.parametrize(("step", "noise"), [(0.01, True), (0.05, False)])
def test_a_gain_that_steps_between_trials_is_no_noise_unless_it_is_as_small_as_cuts_differ_by(step, noise):
    trials = [
        replace(each, measured_n=each.measured_n + gain * (each.predicted_n - each.bias_n))
        for gain, each in zip([step, step, -step, -step], left(growing, steady_n=20.0), strict=True)
    ]
    assert (growing_noise(trials, RATE_HZ, BAND) is not None) == noise


def test_a_short_record_tells_nothing():
    short = [
        replace(each, measured_n=each.measured_n[:100], predicted_n=each.predicted_n[:100])
        for each in left(growing)
    ]
    assert growing_noise(short, RATE_HZ, BAND) is None
