"""Lines off the spindle's multiples: a limit cycle is named, what only looks like one is not."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mjx_cutting.tracing.along.selfexcited import find_vibration
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.prediction import Prediction

TEETH, RATE_HZ, SECONDS, NOISE_N = 4, 2000.0, 1.0, 0.5
SPEEDS = (40.0, 40.3, 52.1, 52.4, 66.0, 66.3)
WAY = np.array([3.0, 2.0, 0.5])


def _session(left, air=(), speeds=SPEEDS):
    """Six cuts that a model leaves `left(time, speed, trial)` [T] of, along one way, and noise."""
    time = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    after, error, energy = [], [], []
    for index, speed in enumerate(speeds):
        noise = NOISE_N * np.random.default_rng(index).normal(size=(len(time), 3))
        residual = left(time, speed, index)[:, None] * WAY + noise
        wave = 50.0 * np.cos(2 * np.pi * TEETH * speed * time)[:, None] * np.ones(3)
        angle = 2 * np.pi * speed * time
        after.append(Prediction(f"t{index}.csv", time, angle, wave + residual, wave, speed, np.zeros(3)))
        error.append(np.sum(residual**2, axis=0))
        energy.append(np.sum((wave + residual) ** 2, axis=0))
    idle = [SimpleNamespace(kind="air", file="a.csv", time_s=time, force_n=each) for each in air]
    dataset = SimpleNamespace(tool=SimpleNamespace(teeth=TEETH), trials=tuple(idle))
    lines = SimpleNamespace(orders=16, band_hz=(0.0, 700.0))
    before = HeldOut(np.stack(error), np.stack(energy), None, np.arange(len(speeds)))
    return dataset, lines, tuple(after), before, np.full(3, 1.0 / NOISE_N)


def _chatter(time, speed, trial):
    """A limit cycle near 385 Hz whose line moves with the speed; the first trial is below the threshold."""
    if trial == 0:
        return np.zeros_like(time)
    own, tooth = 375.0 + 0.2 * speed, TEETH * speed
    turn = 2 * np.pi * own * time + 1.3 * trial
    beside = 2 * np.pi * (own - tooth) * time + 0.4 * trial
    return np.cos(turn) + 0.5 * np.cos(beside)


def test_the_strongest_line_of_a_pattern_may_be_another_at_every_speed():
    """Near 385 Hz in all trials, and stronger by a little a tooth passing below it, at 175 to 225 Hz."""

    def chatter(time, speed, trial):
        own, tooth = 375.0 + 0.2 * speed, TEETH * speed
        turn = 2 * np.pi * time
        return np.cos(turn * own + trial) + (1.1 if trial % 2 else 0.9) * np.cos(turn * (own - tooth))

    found = find_vibration(*_session(chatter))
    assert found is not None and found.round.accepted is not None, found
    said = found.round.accepted.decision.parameters["frequency_hz"]
    assert said.value == pytest.approx(383.0, abs=0.5)
    assert said.high == pytest.approx(375.0 + 0.2 * 66.3, abs=0.5)
    assert "6 of 6" in found.evidence[0]


def test_a_limit_cycle_is_named_with_its_frequency_and_threshold():
    found = find_vibration(*_session(_chatter))
    assert found is not None and found.round.accepted is not None, found
    accepted = found.round.accepted
    said = accepted.decision.parameters["frequency_hz"]
    assert said.low < 375.0 and said.high == pytest.approx(375.0 + 0.2 * 66.3, abs=0.5)
    assert "t0.csv" in found.evidence[1]
    # what is left on stretches that were not fitted to is the noise, and the quiet trial is not touched
    noise = 3 * NOISE_N**2 * RATE_HZ * SECONDS
    np.testing.assert_allclose(accepted.heldout.error_n2.sum(axis=1), noise, rtol=0.1)
    assert not accepted.added_n[0].any() and accepted.added_n[3].any()


def test_a_vibration_far_smaller_than_the_chip_is_given_no_name():
    """What grows until teeth leave the chip is as large as that; lines of a hundredth of the force that stand
    far above the noise come from elsewhere, as from a simulator that puts contact on a grid of time."""
    assert find_vibration(*_session(lambda *trial: 0.4 * _chatter(*trial))) is None


def test_noise_and_a_few_trials_are_given_no_name():
    assert find_vibration(*_session(lambda time, speed, trial: 0.0 * time)) is None
    two = lambda time, speed, trial: _chatter(time, speed, trial) * (trial > 3)  # noqa: E731
    assert find_vibration(*_session(two)) is None


def test_two_trials_are_enough_where_others_at_that_speed_are_quiet():
    """A narrow chip or a larger feed is below the threshold; a gear shakes them all."""
    two = lambda time, speed, trial: 4.0 * _chatter(time, speed, trial) * (trial > 3)  # noqa: E731
    found = find_vibration(*_session(two, speeds=(40.0, 40.3, 66.1, 66.2, 66.0, 66.3)))
    assert found is not None and found.round.accepted is not None
    assert "2 of 6" in found.evidence[0]
    assert find_vibration(*_session(two)) is None


@pytest.mark.parametrize("own_hz", [0.2, 0.0])
def test_of_two_trials_at_two_speeds_one_has_a_quiet_one_beside_it(own_hz):
    """A gear stands at one part of a turn in both, the mains are in the quiet ones too: here the line may
    stand at one frequency in both."""

    def two(time, speed, trial):
        own, tooth = 375.0 + own_hz * speed, TEETH * speed
        turn = 2 * np.pi * time
        return (trial > 3) * (4.0 * np.cos(turn * own + trial) + 2.0 * np.cos(turn * (own - tooth)))

    found = find_vibration(*_session(two, speeds=(40.0, 40.3, 52.1, 66.2, 66.0, 73.4)))
    assert found is not None and found.round.accepted is not None
    assert "2 of 6" in found.evidence[0]


def test_trials_that_are_off_by_more_do_not_hide_it():
    """Two trials whose force is off by far more say nothing for it or against."""

    def beside(time, speed, trial):
        return _chatter(time, speed, trial) * (trial > 1) + 40.0 * np.cos(2 * np.pi * speed * time) * (
            trial < 2
        )

    session = _session(beside)
    found = find_vibration(*session)
    assert found is not None and (accepted := found.round.accepted) is not None
    assert accepted.heldout.nrmse > 0.95 * session[3].nrmse


def test_a_line_that_stays_at_one_frequency_whatever_the_speed_is_not_self_excited():
    def hum(time, speed, trial):
        gain = 1.0 + 0.5 * np.cos(2 * np.pi * TEETH * speed * time)
        return gain * np.cos(2 * np.pi * 90.0 * time + trial)

    found = find_vibration(*_session(hum))
    assert found is not None and found.round.accepted is None
    assert "whatever the speed" in found.round.candidates[0].decision.reasons[0]


def test_lines_at_one_part_of_the_spindle_whatever_the_speed_are_not_self_excited():
    """A worn gear shakes feed and speed .371 times a turn: sidebands of tooth passing at that distance, below
    and above it. Tooth passing of all speeds lies within 15 % of one frequency."""

    def worn(time, speed, trial):
        speed_hz, tooth = 0.371 * speed, TEETH * speed
        turn = 2 * np.pi * time
        return np.cos(turn * (tooth + speed_hz) + trial) + 0.7 * np.cos(turn * (tooth - speed_hz))

    found = find_vibration(*_session(worn, speeds=(50.0, 50.3, 52.1, 52.4, 55.0, 55.3)))
    assert found is not None and found.round.accepted is None
    (candidate,) = found.round.candidates
    assert any(
        "times the spindle's frequency beside tooth passing" in each for each in candidate.decision.reasons
    ), candidate.decision.reasons


@pytest.mark.parametrize("turns_with_the_spindle", [True, False])
def test_at_one_speed_lines_of_a_gear_are_told_by_what_other_speeds_show(turns_with_the_spindle):
    """The first three trials, all at one speed, show two lines; the others one, and small: of a gear at the
    same part of a turn, of a limit cycle at the same frequency."""

    def shaken(time, speed, trial):
        turn = 2 * np.pi * (speed if turns_with_the_spindle else 50.0) * time
        if speed > 51.0:
            return 0.3 * np.cos((TEETH + 0.371) * turn)
        return np.cos((TEETH + 0.371) * turn + trial) + 0.7 * np.cos((TEETH - 0.371) * turn)

    found = find_vibration(*_session(shaken, speeds=(50.0, 50.05, 50.1, 58.0, 61.0, 70.0)))
    assert found is not None
    (candidate,) = found.round.candidates
    turned = [each for each in candidate.decision.reasons if "something that turns with it" in each]
    assert len(turned) == int(turns_with_the_spindle)
    assert (found.round.accepted is None) == turns_with_the_spindle


def test_a_force_that_is_modulated_slowly_is_not_self_excited():
    def periodic(time, speed, trial):
        return np.cos(2 * np.pi * 3.1 * time + trial) * (2.0 + np.cos(2 * np.pi * TEETH * speed * time))

    assert find_vibration(*_session(periodic)) is None


def test_lines_that_are_in_air_too_are_given_no_name():
    time = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    idle = np.cos(2 * np.pi * 386.0 * time)[:, None] * WAY
    idle = idle + NOISE_N * np.random.default_rng(9).normal(size=(len(time), 3))
    found = find_vibration(*_session(_chatter, air=[idle]))
    assert found is not None and found.round.accepted is None
    assert any("in air" in reason for reason in found.round.candidates[0].decision.reasons)


def test_sidebands_of_a_known_wave_of_the_sheet_are_given_no_name():
    feed_m_s, wave_m = np.array([0.08, 0.1, 0.12, 0.08, 0.1, 0.12]), 0.004

    def beating(time, speed, trial):
        turn, tooth, beat = 2 * np.pi * time, TEETH * speed, feed_m_s[trial] / wave_m
        return np.cos(turn * (tooth + beat)) + np.cos(turn * (tooth - beat))

    session = _session(beating)
    assert find_vibration(*session).round.accepted is not None
    assert find_vibration(*session, waves_hz=(feed_m_s / wave_m)[:, None]) is None
    other = find_vibration(*_session(_chatter), waves_hz=(feed_m_s / wave_m)[:, None])
    assert other is not None and other.round.accepted is not None
