"""A speed that was heard in the force, not measured, is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjx_cutting.tracing.telling.heard_speeds import heard_speeds


def _with_speeds(dataset, shares):
    """The trials with a column of a speed that swings by each of the shares; none where that is nil."""
    trials = []
    for trial, share in zip(dataset.trials, shares, strict=True):
        swing = 1.0 + share * np.sin(np.linspace(0.0, 2.0 * np.pi, len(trial.time_s)))
        column = trial.spindle_speed_rev_s * swing if share else None
        trials.append(replace(trial, spindle_speed_measured_rev_s=column))
    return replace(dataset, trials=tuple(trials))


def test_the_trials_heard_are_told_those_that_wander_most_first(mill):
    dataset = mill()
    shares = [0.0, 1e-3, 3e-3, *(0.0 for _ in dataset.trials[3:])]
    told = heard_speeds(_with_speeds(dataset, 0.0 * np.array(shares)), _with_speeds(dataset, shares))
    assert told is not None
    assert f"({dataset.trials[2].file} by 0.30%, {dataset.trials[1].file} by 0.10%)" in told


def test_a_speed_that_was_measured_is_not_said_to_be_heard(mill):
    measured = _with_speeds(mill(), [2e-3 for _ in mill().trials])
    assert heard_speeds(measured, measured) is None
