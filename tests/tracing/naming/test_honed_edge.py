"""An insert with a heavily honed edge ploughs at feeds that a lathe is set to, and that is seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting.tracing import trace

CHIP_N_M2 = np.array([-0.3e9, 0.6e9, -0.11e9])
RATIO = np.array([6.0, 2.5, 2.8])
THINNEST_M = 56e-6


def test_a_minimum_chip_among_the_feeds_of_a_lathe_is_found():
    dataset = make("turning", {}, 500).dataset
    draw = np.random.default_rng(1)
    cuts = sum(trial.kind == "cut" for trial in dataset.trials)
    chips = iter(np.resize([27e-6, 56e-6, 93e-6, 150e-6, 225e-6], cuts))
    trials = []
    for trial in dataset.trials:
        noise = draw.normal(0.0, 2.0, trial.force_n.shape)
        if trial.kind != "cut":
            trials.append(replace(trial, force_n=noise))
            continue
        chip_m = float(next(chips))
        bent_m = RATIO * min(chip_m, THINNEST_M) + max(chip_m - THINNEST_M, 0.0)
        force = trial.axial_width_m * CHIP_N_M2 * bent_m
        feed = chip_m * trial.spindle_speed_rev_s
        as_cut = replace(trial, force_n=force + noise, feed_speed_m_s=feed, feed_speed_measured_m_s=None)
        trials.append(as_cut)
    sensor = replace(dataset.sensor, noise_std_n=(2.0, 2.0, 2.0))
    found = trace(
        replace(dataset, trials=tuple(trials), sensor=sensor),
        effects=("ploughing", "size_effect", "flank_wear"),
    )
    (named,) = found.verdict["effects"]
    assert (found.verdict["verdict"], named["name"]) == ("explained", "ploughing")
    assert named["parameters"]["minimum_chip_m"]["value"] == pytest.approx(THINNEST_M, rel=0.1)
    np.testing.assert_allclose(named["parameters"]["ratio"]["values"], [2.5, 6.0, 2.8], rtol=0.25)
