"""Single samples that stand out are found and bridged; what a tooth does turn by turn is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial
from mjx_cutting.trials.spikes import find_spikes, trial_spikes, without_spikes

RATE_HZ, TURN = 2000.0, 100.0
T = np.arange(6000)


def force(seed: int, noise: float = 1.0, quantum: float = 0.0) -> np.ndarray:
    """Two teeth a turn, in the cut for a quarter of it each."""
    angle = 2.0 * np.pi * T / TURN
    teeth = 60.0 * np.clip(np.sin(2.0 * angle + seed), 0.0, None) - 20.0
    signal = teeth + noise * np.random.default_rng(seed).normal(size=T.size)
    return np.round(signal / quantum) * quantum if quantum else signal


@pytest.mark.parametrize("at", [[700], [2, 3000], [1500, 1501], [100, 2222, 5997]])
def test_spikes_are_found(at):
    signal = force(1)
    signal[at] += 150.0
    np.testing.assert_array_equal(find_spikes(signal, TURN), at)


@pytest.mark.parametrize(
    ("many", "height_n", "found"),
    [(22, 150.0, True), (28, 600.0, True), (28, 40.0, False), (130, 600.0, False)],
)
def test_of_too_many_something_else_is_the_matter(many, height_n, found):
    """6000 samples; more than 24 must stand out further, and a burst is not 130 spikes."""
    signal, at = force(3), 37 + 43 * np.arange(many)
    signal[at] += height_n
    np.testing.assert_array_equal(find_spikes(signal, TURN), at if found else [])


def test_spikes_a_turn_apart_by_chance_are_found_among_many():
    """A tooth's blow is there in the turn before and in the next."""
    signal, at = force(3), np.sort(np.append(37 + 211 * np.arange(27), 1192))
    signal[at] += 600.0
    np.testing.assert_array_equal(find_spikes(signal, TURN), at)
    blows = force(3)
    blows[50::100] += 600.0
    assert set(find_spikes(blows, TURN)) <= {50, 5950}


@settings(max_examples=100, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    noise=st.sampled_from([0.0, 0.1, 2.0]),
    quantum=st.sampled_from([0.0, 0.05, 3.0]),
    teeth=st.booleans(),
)
def test_sound_signals_have_none(seed, noise, quantum, teeth):
    signal = force(seed, noise, quantum) - (0.0 if teeth else force(seed, 0.0))
    assert len(find_spikes(signal, TURN)) == 0


@pytest.mark.parametrize("swings", [1.0, 2.0, 7.5])
def test_what_is_smooth_and_without_noise_has_none(swings):
    signal = 10.0 * np.sin(2.0 * np.pi * swings * np.arange(1000) / 500.0)
    assert len(find_spikes(signal, TURN)) == 0


def test_a_blow_in_every_turn_is_no_spike():
    """Once in 700 samples, rarer than what the usual distance is counted over."""
    signal = force(2)
    signal[350::700] += 150.0
    assert len(find_spikes(signal, 700.4)) == 0


def test_a_tool_that_enters_at_once_is_no_spike():
    signal = np.where(T < 2500, 0.0, 80.0) + np.random.default_rng(0).normal(size=T.size)
    assert len(find_spikes(signal, TURN)) == 0


def _dataset(force_n: np.ndarray) -> Dataset:
    trial = Trial(
        file="t1.csv",
        kind="cut",
        milling="slot",
        spindle_speed_rev_s=RATE_HZ / TURN,
        feed_speed_m_s=0.01,
        radial_depth_m=0.01,
        axial_width_m=1e-3,
        time_s=T / RATE_HZ,
        force_n=force_n,
    )
    tool = ToolInfo("end_mill", 2, 0.01)
    return Dataset(name="spikes", tool=tool, sensor=Sensor(RATE_HZ), trials=(trial,), axes=("-y", "+x", "+z"))


def test_a_line_takes_their_place_and_their_columns_are_told():
    sound = np.stack([force(seed) for seed in range(3)], axis=1)
    spoiled = sound.copy()
    spoiled[1000, 0] += 150.0
    spoiled[[2000, 2001], 2] -= 150.0
    made = _dataset(spoiled)
    # process x is column y of the file
    found = trial_spikes(made.trials[0], made.axes)
    assert {name: spikes.tolist() for name, spikes in found.items()} == {
        "force_y_n": [1000],
        "force_z_n": [2000, 2001],
    }
    mended, (said,) = without_spikes(made)
    assert said.startswith("t1.csv: 3 samples far from their neighbours") and "the first at 0.5 s" in said
    expected = sound.copy()
    expected[1000, 0] = 0.5 * (sound[999, 0] + sound[1001, 0])
    expected[2000:2002, 2] = np.interp([2000, 2001], [1999, 2002], sound[[1999, 2002], 2])
    np.testing.assert_allclose(mended.trials[0].force_n, expected, rtol=1e-12)


def test_of_a_drill_thrust_and_torque_are_mended():
    trial = _dataset(np.stack([np.full(T.size, np.nan)] * 2 + [force(1)], axis=1)).trials[0]
    torque = 0.01 * force(2)
    torque[4000] += 2.0
    made = replace(_dataset(trial.force_n), tool=ToolInfo("drill", 2, 0.01), axes=None)
    made = replace(made, trials=(replace(trial, milling=None, torque_nm=torque),))
    mended, (said,) = without_spikes(made)
    assert "torque_z_nm" in said
    assert mended.trials[0].torque_nm[4000] == pytest.approx(0.5 * (torque[3999] + torque[4001]))
    np.testing.assert_array_equal(mended.trials[0].force_n[:, 2], trial.force_n[:, 2])


def test_nothing_is_touched_where_there_are_none():
    made = _dataset(np.stack([force(seed) for seed in range(3)], axis=1))
    mended, said = without_spikes(made)
    assert mended is made and said == ()
