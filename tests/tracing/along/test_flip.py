"""Flip chatter hides in the spindle's own orders: its threshold tells it from teeth that are not alike."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mjx_cutting.tracing.along.flip import flipping
from mjx_cutting.tracing.along.selfexcited import find_vibration
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.prediction import Prediction

RATE_HZ, SECONDS, NOISE_N, ORDERS = 1000.0, 2.0, 0.5, 24
SPEEDS = (16.9, 16.88, 16.91, 19.0, 19.03, 18.98)
WAY = np.array([3.0, 2.0, 0.5])


def _session(left, teeth=20, clock=None):
    """Six cuts of which the model leaves `left(angle, trial)` [T] along one way, and noise."""
    time = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    after, error, energy, cuts = [], [], [], []
    for index, speed in enumerate(SPEEDS):
        angle = 2 * np.pi * speed * time + index
        noise = NOISE_N * np.random.default_rng(index).normal(size=(len(time), 3))
        residual = left(angle, index)[:, None] * WAY + noise
        wave = 20.0 * np.cos(teeth * angle)[:, None] * np.ones(3)
        file = f"t{index}.csv"
        after.append(Prediction(file, time, angle, wave + residual, wave, speed, np.zeros(3)))
        error.append(np.sum(residual**2, axis=0))
        energy.append(np.sum((wave + residual) ** 2, axis=0))
        when = None if clock is None else float(clock[index])
        cuts.append(SimpleNamespace(kind="cut", file=file, tool_id="a", clock_start_s=when))
    dataset = SimpleNamespace(tool=SimpleNamespace(teeth=teeth), trials=tuple(cuts))
    lines = SimpleNamespace(orders=ORDERS, band_hz=(0.0, 450.0))
    before = HeldOut(np.stack(error), np.stack(energy), None, np.arange(len(SPEEDS)))
    return dataset, lines, tuple(after), before, np.full(3, 1.0 / NOISE_N)


def _names(session):
    found = find_vibration(*session)
    return found is not None and found.round.accepted is not None


def test_half_of_tooth_passing_in_some_cuts_and_gone_in_others_is_a_flip_lobe():
    """At 16.9 rev/s two cuts of three shake: half of 20 teeth is 169 Hz."""
    flip = lambda angle, trial: (4.0 if trial in (0, 1) else 0.0) * np.cos(10 * angle + trial)  # noqa: E731
    found = find_vibration(*_session(flip))
    assert found is not None and found.round.accepted is not None
    accepted = found.round.accepted
    assert accepted.kind.name == "regenerative_chatter"
    assert accepted.decision.parameters["frequency_hz"].value == pytest.approx(168.8, abs=0.3)
    assert "2 of 6" in found.evidence[0] and "t0.csv, t1.csv" in found.evidence[0]
    noise = 3 * NOISE_N**2 * RATE_HZ * SECONDS
    np.testing.assert_allclose(accepted.heldout.error_n2.sum(axis=1), noise, rtol=0.1)
    assert accepted.added_n[0].any() and not accepted.added_n[2].any()


def test_teeth_that_alternate_do_so_in_every_cut():
    size = np.array([4.0, 2.0, 1.0, 4.0, 2.0, 1.0])
    assert not _names(_session(lambda angle, trial: size[trial] * np.cos(10 * angle)))


def test_a_resonance_at_one_speed_shakes_all_cuts_at_it():
    assert not _names(_session(lambda angle, trial: (4.0 if trial < 3 else 0.0) * np.cos(10 * angle)))


def test_a_damaged_tooth_fills_the_other_orders_too():
    def comb(angle, trial):
        orders = np.arange(1, 20)[:, None]
        return (1.0 if trial in (0, 1) else 0.0) * np.sum(np.cos(orders * angle), axis=0)

    assert not _names(_session(comb))


def test_an_odd_number_of_teeth_has_no_such_line():
    flip = lambda angle, trial: (4.0 if trial in (0, 1) else 0.0) * np.cos(10 * angle)  # noqa: E731
    dataset, lines, after, *_ = _session(flip, teeth=21)
    assert flipping(dataset, after, lines.orders) == {}


@pytest.mark.parametrize("clock, found", [((5, 1, 6, 2, 3, 4), True), ((5, 6, 1, 2, 3, 4), False)])
def test_two_teeth_must_be_alike_again_after_a_cut_that_shakes(clock, found):
    """A tooth that loses a part leaves the once-per-revolution line in every cut that follows."""
    flip = lambda angle, trial: (4.0 if trial in (0, 1) else 0.0) * np.cos(angle + trial)  # noqa: E731
    assert _names(_session(flip, teeth=2, clock=clock)) == found


@pytest.mark.parametrize(
    "size, clock, found",
    [(4.0, (2, 1, 3, 4, 5, 6), True), (0.5, (2, 1, 3, 4, 5, 6), False), (4.0, (6, 1, 2, 3, 4, 5), False)],
)
def test_one_cut_alone_must_shake_much_and_be_quiet_again_after_it(size, clock, found):
    flip = lambda angle, trial: (size if trial == 0 else 0.0) * np.cos(10 * angle + trial)  # noqa: E731
    assert _names(_session(flip, clock=clock)) == found


def test_trials_off_the_orders_and_at_a_flip_lobe_are_named_together():
    """Three cuts at 19 rev/s vibrate near 120 Hz, off the orders, two at 16.9 at half of tooth passing."""

    def both(angle, trial):
        if trial > 2:
            own = 120.0 / SPEEDS[trial]
            return 3.0 * np.cos(own * angle) + 1.5 * np.cos((20.0 - own) * angle)
        return (4.0 if trial in (0, 1) else 0.0) * np.cos(10 * angle)

    found = find_vibration(*_session(both))
    assert found is not None and found.round.accepted is not None
    shaken = [bool(wave.any()) for wave in found.round.accepted.added_n]
    assert shaken == [True, True, False, True, True, True]
    assert found.round.accepted.decision.parameters["frequency_hz"].value == pytest.approx(120.0, abs=0.5)
    assert any("flip lobe" in each for each in found.evidence)
