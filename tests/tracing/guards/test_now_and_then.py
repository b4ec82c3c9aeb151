"""A steady effect is there in every turn; what comes and goes is imitated by one in the mean."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.guards.now_and_then import rather_now_and_then

RATE_HZ, SPEED_REV_S, SAMPLES, NOISE_N = 500.0, 10.0, 2000, 0.2
TIME_S = np.arange(SAMPLES) / RATE_HZ
ANGLE_RAD = 2.0 * np.pi * SPEED_REV_S * TIME_S
TURN = (TIME_S * SPEED_REV_S).astype(int)


def _why(share, beside_n: float = 0.0, effect_n: float = 2.0, hum_n: float = 0.0) -> str | None:
    """Judged on six trials: a force at tooth passing, of which a part `beside_n` that no model has goes with
    the place, and a line once a turn of which `share(turn, generator)` is there; the model has its mean."""
    generator = np.random.default_rng(3)
    passing, line = (np.cos(each * ANGLE_RAD)[:, None] * np.ones(3) for each in (4.0, 1.0))
    before, after = [], []
    for index in range(6):
        there = share(TURN, generator)[:, None]
        wave = beside_n * np.cos(2.0 * np.pi * 1.7 * TIME_S + index)[:, None] * passing
        measured = 10.0 * passing + wave + effect_n * there * line
        measured += hum_n * np.cos(4.0 / 3.0 * ANGLE_RAD)[:, None]
        measured += generator.normal(0.0, NOISE_N, measured.shape)
        for found, predicted in ((before, 0.0), (after, effect_n * there.mean() * line)):
            file = f"t{index}.csv"
            predicted = 10.0 * passing + predicted
            found.append(Prediction(file, TIME_S, ANGLE_RAD, measured, predicted, SPEED_REV_S, np.zeros(3)))
    force = np.sqrt(np.mean([np.mean(each.measured_n**2) for each in before]))
    return rather_now_and_then(before, after, NOISE_N / float(force), 1.0)


def _by_runs(turn, generator, of=8):
    """There for some turns, then away for some."""
    return np.repeat(generator.integers(0, 2, 1 + turn.max() // of), of)[turn].astype(float)


@pytest.mark.parametrize("of", [3, 8])
def test_what_comes_and_goes_is_no_steady_cause(of):
    assert "comes and goes" in (_why(partial(_by_runs, of=of)) or "")


def test_what_a_force_beside_it_lends_short_blocks_is_no_coming_and_going():
    """Beside a force at a third of an order that is ten times the effect."""
    assert _why(lambda turn, generator: np.ones(len(turn)), effect_n=0.5, hum_n=5.0) is None


def test_what_is_there_in_every_turn_is_let_be():
    assert _why(lambda turn, generator: np.ones(len(turn))) is None


def test_a_sheet_that_is_harder_by_turns_does_not_make_a_line_come_and_go():
    assert _why(lambda turn, generator: 1.0 + 0.4 * np.sin(0.3 * turn), beside_n=5.0) is None


def test_noise_does_not_either():
    assert _why(lambda turn, generator: np.ones(len(turn)), effect_n=0.01) is None
