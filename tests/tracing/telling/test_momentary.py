"""A factor on all of the force that moves along a trial, told from a force beside that of the cut."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.telling.dependence import dependences
from mjx_cutting.tracing.telling.momentary import momentary


@pytest.fixture(scope="module")
def dataset(mill):
    return mill()


def _eased(time_s: np.ndarray, seed: int) -> np.ndarray:
    """[T] share by which the force is lower, for moments that come at random and last for some turns."""
    moments = np.random.default_rng(seed).uniform(time_s[0], time_s[-1], 4)
    return -0.2 * np.exp(-(((time_s[:, None] - moments) / 0.06) ** 2)).sum(axis=1)


def _predictions(dataset, added) -> list[Prediction]:
    """Predictions that lack `added(trial, index)` [T, 3] beside noise."""
    generator, found = np.random.default_rng(0), []
    for index, trial in enumerate(dataset.trials):
        missing = added(trial, index) + generator.normal(size=trial.force_n.shape)
        angle = 2.0 * np.pi * trial.spindle_speed_rev_s * trial.time_s
        predicted = trial.force_n - missing
        found.append(Prediction(trial.file, trial.time_s, angle, trial.force_n, predicted, 40.0, np.zeros(3)))
    return found


def _factor(trial, index) -> np.ndarray:
    return _eased(trial.time_s, index)[:, None] * trial.force_n


def _beside(trial, index) -> np.ndarray:
    """As slow, and as large, but along x alone and whatever the force is."""
    return np.outer(_eased(trial.time_s, index), [40.0, 0.0, 0.0])


def test_a_factor_is_told_with_its_share(dataset):
    predictions = _predictions(dataset, _factor)
    found = momentary(predictions, band=1.0)
    assert found is not None
    eased = [_factor(trial, index) for index, trial in enumerate(dataset.trials)]
    size = sum(float(np.sum((each - each.mean(axis=0)) ** 2)) for each in eased)
    samples = sum(trial.force_n.size for trial in dataset.trials)
    assert found.share == pytest.approx(size / (size + samples), abs=0.05)


def test_a_force_beside_the_cut_is_no_factor(dataset):
    assert momentary(_predictions(dataset, _beside), band=1.0) is None


def test_noise_is_no_factor(dataset):
    assert momentary(_predictions(dataset, lambda trial, index: 0.0 * trial.force_n), band=1.0) is None


@pytest.mark.parametrize(("added", "told"), [(_factor, True), (_beside, False)])
def test_a_factor_ties_no_axes(dataset, added, told):
    found = {each.covariate: each for each in dependences(dataset, _predictions(dataset, added), 4, 12)}
    assert found["time in trial"].found and not found["another axis"].found
    assert ("on every axis alike" in found["time in trial"].look_for) == told
