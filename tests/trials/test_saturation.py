"""Saturation is found where it is and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjx_cutting.trials.saturation import find_saturation

T = np.arange(4000) / 500.0


def noisy_sine(seed: int, amplitude: float, frequency_hz: float, noise: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return (
        amplitude * np.sin(2 * np.pi * frequency_hz * T) + noise * rng.normal(size=T.size) + 0.3 * amplitude
    )


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    amplitude=st.floats(0.5, 500),
    frequency_hz=st.floats(0.2, 200),
    noise=st.sampled_from([0.02, 0.3, 3.0]),
    quantum=st.sampled_from([0.0, 0.01, 0.1, 1.0]),
)
def test_sound_signals_quantised_or_not_pass(seed, amplitude, frequency_hz, noise, quantum):
    signal = noisy_sine(seed, amplitude, frequency_hz, noise)
    if quantum:
        signal = np.round(signal / quantum) * quantum
    assert find_saturation(signal) is None


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    frequency_hz=st.floats(0.5, 200),
    share=st.floats(0.6, 0.95),
    upper=st.booleans(),
    quantum=st.sampled_from([0.0, 0.05]),
)
def test_clipped_signals_are_found(seed, frequency_hz, share, upper, quantum):
    signal = noisy_sine(seed, 100.0, frequency_hz, 1.0) - 30.0
    if quantum:
        signal = np.round(signal / quantum) * quantum
    limit = round(share * 100.0)
    clipped = np.minimum(signal, limit) if upper else np.maximum(signal, -limit)
    found = find_saturation(clipped)
    assert found is not None
    assert found.value == (limit if upper else -limit)
    assert found.samples == int((clipped == found.value).sum())
    assert 1 <= found.longest_run <= found.samples


def test_one_long_run_is_enough():
    signal = noisy_sine(0, 10.0, 30.0, 1.0)
    signal[100:110] = 80.0
    found = find_saturation(signal)
    assert found is not None and (found.value, found.samples, found.longest_run) == (80.0, 10, 10)


def test_rest_at_zero_is_no_saturation():
    """A one-sided force that is exactly 0 out of contact repeats its smallest value."""
    contact = np.maximum(np.sin(2 * np.pi * 20 * T), 0) * (1 + 0.1 * np.random.default_rng(0).random(T.size))
    assert find_saturation(contact) is None
    assert find_saturation(-contact) is None


@pytest.mark.parametrize("signal", [np.zeros(100), np.full(100, 5.0), np.ones(3), np.full(100, np.nan)])
def test_constant_short_and_broken_signals_are_left_to_other_checks(signal):
    assert find_saturation(signal) is None


def test_a_noise_free_plateau_with_a_smooth_entry_is_no_saturation():
    ramp = np.linspace(0.0, 5.0, 50)
    assert find_saturation(np.concatenate([ramp, np.full(300, 5.0), ramp[::-1]])) is None
