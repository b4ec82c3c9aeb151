"""A descent along an unknown that changes nothing does not stop the others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing import trace
from mjx_cutting.trials.dataset import AntiAlias, Sensor, ToolInfo
from mjx_cutting.trials.synthetic import Conditions, Sheet, make_trials

MOMENT_KG_M = 4.2e-5


@pytest.fixture(scope="module")
def unbalanced():
    """A fine saw behind a slow filter: no tooth passing is heard, so the phase against tooth 0 is any."""
    cuts = [
        Conditions(speed, feed, depth, 0.0022, "climb")
        for speed, feed, depth in (
            (20.0, 0.03, 2e-3), (26.0, 0.03, 2e-3), (33.0, 0.03, 3e-3), (40.0, 0.06, 2e-3),
            (20.0, 0.06, 4e-3), (33.0, 0.06, 4e-3), (40.0, 0.09, 3e-3), (26.0, 0.09, 3e-3),
        )
    ]  # fmt: skip
    sheet = Sheet((2.8e7, 9.4e6, 2.2e6), (3.5e3, 1.6e3, 350.0))
    sensor = Sensor(500.0, (0.4, 0.4, 0.5), anti_alias=AntiAlias(order=4, hz=180.0))
    dataset = make_trials(
        ToolInfo("slitting_saw", 48, 0.1), sheet, cuts, sensor, duration_s=4.0, seed=2, speed_error=0.0
    )
    trials = []
    for index, trial in enumerate(dataset.trials):
        rate = 2.0 * np.pi * trial.spindle_speed_rev_s
        angle = rate * trial.time_s + index
        turning = np.stack([np.sin(angle), np.cos(angle), 0.0 * angle], axis=1)
        trials.append(replace(trial, force_n=trial.force_n + MOMENT_KG_M * rate**2 * turning))
    return replace(dataset, trials=tuple(trials))


def test_an_unbalance_whose_phase_shows_nowhere_has_its_size(unbalanced):
    verdict = trace(unbalanced, effects=("unbalance", "radial_runout")).verdict
    (named,) = verdict["effects"]
    said = named["parameters"]
    assert named["name"] == "unbalance" and verdict["verdict"] == "explained"
    # the filter lets through .99 or more at these speeds
    assert said["moment_kg_m"]["value"] == pytest.approx(MOMENT_KG_M, rel=0.02)
    assert said["moment_kg_m"]["low"] < MOMENT_KG_M < said["moment_kg_m"]["high"]
    assert (said["phase_rad"]["low"], said["phase_rad"]["high"]) == pytest.approx((-np.pi, np.pi))
