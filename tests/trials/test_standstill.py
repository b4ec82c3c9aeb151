"""A channel that hangs is found; one that rests with the others, or has coarse quanta, is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjx_cutting.trials.standstill import Standstill, find_standstill

T = np.arange(3000) / 1000.0


def force(seed: int, noise: float = 1.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return 20.0 * np.sin(2 * np.pi * 7.3 * T + seed) - 15.0 + noise * rng.normal(size=T.size)


@pytest.mark.parametrize("held", [slice(700, 760), slice(0, 1500), slice(1200, None)])
@pytest.mark.parametrize("value", [0.0, -9.5])
def test_a_channel_that_holds_a_value_is_found(held, value):
    signal = force(0)
    signal[held] = value
    first, last, _ = held.indices(len(signal))
    assert find_standstill(signal, [force(1), force(2)]) == Standstill(first, last - first, value)


def test_a_tool_in_the_air_brings_all_channels_to_rest():
    channels = [force(0), force(1), force(2)]
    for each in channels:
        each[:900] = 0.0
    assert find_standstill(channels[0], channels[1:]) is None


def test_noise_in_the_air_is_no_cut_that_goes_on():
    channels = [force(0), force(1)]
    channels[0][:900] = 0.0
    channels[1][:900] = np.random.default_rng(3).normal(size=900)
    assert find_standstill(channels[0], channels[1:]) is None


def test_a_simulated_axis_may_hold_nothing_at_all():
    assert find_standstill(np.zeros(T.size), [force(1)]) is None


@settings(max_examples=100, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    noise=st.sampled_from([0.1, 1.0, 5.0]),
    amplitude=st.sampled_from([0.0, 1.0, 30.0]),
    quantum=st.sampled_from([0.0, 0.05, 1.0, 4.0]),
)
def test_sound_channels_quantised_or_not_pass(seed, noise, amplitude, quantum):
    rng = np.random.default_rng(seed)
    signal = amplitude * np.sin(2 * np.pi * 3.1 * T) + noise * rng.normal(size=T.size)
    if quantum:
        signal = np.round(signal / quantum) * quantum
    assert find_standstill(signal, [force(seed)]) is None
