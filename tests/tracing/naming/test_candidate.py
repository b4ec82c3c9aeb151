"""What counts against chance where levels of one trial rise and fall together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.study import make
from mjx_cutting.tracing import trace
from mjx_cutting.trials.dataset import Dataset


def _scattered(hidden: dict[str, str | float], seed: int) -> Dataset:
    """A turning session in which all forces of a trial are off by one factor, .4 % from trial to trial."""
    dataset, generator = make("turning", hidden, seed=seed).dataset, np.random.default_rng(seed)
    factors = generator.normal(1.0, 0.004, len(dataset.trials))
    trials = (
        replace(each, force_n=each.force_n * factor) if each.kind == "cut" else each
        for each, factor in zip(dataset.trials, factors, strict=True)
    )
    return replace(dataset, trials=tuple(trials))


def test_a_drift_is_told_from_factors_of_the_trials():
    found = trace(_scattered({"thermal_drift": "strong"}, 400))
    (drift,) = found.verdict["effects"]
    assert drift["name"] == "thermal_drift"
    assert found.final.nrmse < 0.4 * found.search.base.nrmse


def test_factors_of_the_trials_alone_are_no_effect():
    assert trace(_scattered({}, 400)).verdict["effects"] == []
