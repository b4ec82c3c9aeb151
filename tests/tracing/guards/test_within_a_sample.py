"""A helix that moves an edge by next to nothing is what any reading of the force does."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing.guards.gain import Gain
from mjx_cutting.tracing.guards.within_a_sample import rather_the_reading

HELIX = effect_class("helix_lag")
WIDTH_M, RADIUS_M, SLOWEST_REV_S = 2e-3, 8e-3, 40.0


@pytest.fixture
def why(mill, posed):
    """Call it with the angle stated, the correction found, and the sampling rate."""

    def of(stated_rad: float, more_rad: float, rate_hz: float, effects=(HELIX,)):
        dataset = mill()
        dataset = replace(dataset, tool=replace(dataset.tool, helix_rad=stated_rad))
        with jax.enable_x64(True):
            lines, problem = posed(dataset)
        read = replace(dataset, sensor=replace(dataset.sensor, sample_rate_hz=rate_hz))
        found = SimpleNamespace(model=SimpleNamespace(effects=(effects[-1](more_rad), "given")))
        return rather_the_reading(Gain(problem, replace(lines, dataset=read), effects, None, found))

    return of


@pytest.mark.parametrize("stated_rad", [0.0, 0.5])
def test_it_counts_from_a_tenth_of_a_sample_in_the_slowest_trial(why, stated_rad):
    more_rad = 0.03
    lag_rad = WIDTH_M / RADIUS_M * (np.tan(stated_rad + more_rad) - np.tan(stated_rad))
    limit_hz = 0.1 * 2.0 * np.pi * SLOWEST_REV_S / lag_rad
    assert why(stated_rad, more_rad, 1.01 * limit_hz) is None
    assert "of the time between two samples" in why(stated_rad, more_rad, 0.99 * limit_hz)
    assert why(stated_rad, -more_rad, 0.8 * limit_hz) is not None


def test_other_effects_are_not_asked(why):
    assert why(0.0, 1e-9, 5000.0, (HELIX, effect_class("spindle_droop"))) is None
