"""A force that scatters from tooth to tooth is noise; what repeats with the spindle, or is large, is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing import trace
from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.telling.unlike_chips import unlike_chips
from mjx_cutting.trials.dataset import Dataset
from mjx_cutting.trials.synthetic import Hidden

RATE_HZ = 2000.0
BAND_HZ = (0.0, 800.0)
PASSING_HZ = 80.0
NOISE_N = 0.1


def _chips(scatter: float, line_n: float = 0.0, seed: int = 0) -> list[Prediction]:
    """Four records of 100 N pulses, one a tooth, each off by `scatter` or so, in noise; and a line."""
    generator, time = np.random.default_rng(seed), np.arange(8000) / RATE_HZ
    turn = PASSING_HZ * time
    told = 100.0 * np.maximum(np.sin(2.0 * np.pi * turn), 0.0)[:, None] * np.ones(3)
    found = []
    for _ in range(4):
        own = generator.normal(size=int(turn[-1]) + 1)[turn.astype(int)][:, None]
        noise = NOISE_N * generator.normal(size=told.shape)
        line = line_n * np.sin(2.0 * np.pi * 0.25 * turn)[:, None]
        measured = (1.0 + scatter * own) * told + noise + line
        found.append(Prediction("a.csv", time, time, measured, told, 1.0, np.zeros(3)))
    return found


FLOOR = NOISE_N * np.sqrt(0.8) / 50.0


@pytest.mark.parametrize("scatter", [0.004, 0.008])
def test_chips_that_scatter_by_less_than_a_hundredth_are_counted_as_noise(scatter):
    left = _chips(scatter)
    force = sum(np.sum(each.measured_n**2) for each in left)
    whole = np.sqrt(sum(np.sum(each.residual_n**2) for each in left) / force)
    found = unlike_chips(left, FLOOR, RATE_HZ, BAND_HZ)
    assert found == pytest.approx(whole, rel=0.05) and found > 1.5 * FLOOR


def test_by_more_they_are_not():
    assert unlike_chips(_chips(0.02), FLOOR, RATE_HZ, BAND_HZ) is None


def test_what_repeats_with_the_spindle_counts_as_little_as_its_neighbours():
    alone, beside = (unlike_chips(_chips(0.006, line), FLOOR, RATE_HZ, BAND_HZ) for line in (0.0, 3.0))
    assert beside == pytest.approx(alone, rel=0.02)


def test_noise_of_the_sensor_alone_is_nothing_more():
    assert unlike_chips(_chips(0.0), 1.02 * FLOOR, RATE_HZ, BAND_HZ) is None


def _with_unlike_chips(dataset: Dataset, scatter: float) -> Dataset:
    """Every tooth of a trial with a force of its own."""
    generator, trials = np.random.default_rng(1), []
    for each in dataset.trials:
        tooth = (dataset.tool.teeth * each.spindle_speed_rev_s * each.time_s).astype(int)
        own = generator.normal(size=tooth.max() + 1)[tooth][:, None]
        trials.append(replace(each, force_n=(1.0 + scatter * own) * each.force_n))
    return replace(dataset, trials=tuple(trials))


@pytest.mark.parametrize(("scatter", "word"), [(0.008, "explained"), (0.05, "partly explained")])
def test_beside_a_name_they_leave_nothing_to_explain(mill, scatter, word):
    made = _with_unlike_chips(mill(Hidden(runout_m=8e-6)), scatter)
    verdict = trace(made, effects=["radial_runout", "size_effect"]).verdict
    assert verdict["verdict"] == word
    assert [each["name"] for each in verdict["effects"]] == ["radial_runout"]
    assert ("not alike" in verdict["remaining"]["description"]) == (word == "explained")
