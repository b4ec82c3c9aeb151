"""A reading of the columns that explains everything is taken, though noise is most of what either leaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing import trace

CUTOFF_HZ, NOISE_N = 260.0, 8.0


@pytest.mark.slow
def test_a_wrong_sign_that_two_effects_nearly_explain_is_found_beneath_noise(hiding):
    clean = hiding({"sensor_lowpass": {"cutoff_hz": CUTOFF_HZ, "order": 1.0}})
    noise = np.random.default_rng(0)
    trials = tuple(
        replace(
            trial,
            force_n=(trial.force_n + NOISE_N * noise.normal(size=trial.force_n.shape)) * [1.0, -1.0, 1.0],
        )
        for trial in clean.trials
    )
    found = trace(
        replace(clean, trials=trials, axes=None, sensor=replace(clean.sensor, noise_std_n=None)),
        effects=("sensor_lowpass", "robot_mode", "time_offset"),
    )
    (named,) = found.verdict["effects"]
    assert (found.verdict["verdict"], named["name"]) == ("explained", "sensor_lowpass")
    assert found.dataset.axes[1] == "-y"
    assert named["parameters"]["cutoff_hz"]["value"] == pytest.approx(CUTOFF_HZ, rel=0.05)
