"""What stands above the band compared is told, and only where there is something."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing import trace
from mjx_cutting.tracing.records.lines import trusted_band
from mjx_cutting.tracing.telling.above_band import above_band

BAND_HZ = (0.0, 400.0)


@pytest.fixture(scope="module")
def traced(mill):
    dataset = mill()
    return dataset, trace(dataset, band_hz=BAND_HZ, effects=())


def _ringing(dataset, amplitude_n: float):
    """The trials with lines at multiples of the spindle between 700 and 800 Hz, as behind a resonance."""
    trials = []
    for trial in dataset.trials:
        speed = trial.spindle_speed_rev_s
        orders = [n for n in range(200) if 700.0 < n * speed < 800.0]
        wave = sum(np.cos(2.0 * np.pi * n * speed * trial.time_s) for n in orders)
        trials.append(replace(trial, force_n=trial.force_n + amplitude_n * np.asarray(wave)[:, None]))
    return replace(dataset, trials=tuple(trials))


def test_nothing_is_said_of_noise_and_of_what_the_model_calculates(traced):
    dataset, found = traced
    assert above_band(dataset, found.model, BAND_HZ) is None
    assert found.caveats == ()


def test_nothing_is_looked_for_beyond_the_sensor(traced):
    dataset, found = traced
    loud = _ringing(dataset, 20.0)
    assert above_band(loud, found.model, trusted_band(dataset, None)) is None


def test_lines_of_a_resonance_are_told_with_their_place_and_size(traced):
    dataset, found = traced
    amplitude_n = 20.0
    loud = _ringing(dataset, amplitude_n)
    above = above_band(loud, found.model, BAND_HZ)
    assert above is not None and above.top_hz == 1000.0
    assert 680.0 < above.low_hz < 720.0 and 740.0 < above.high_hz < 820.0
    count = np.mean([sum(700.0 < n * t.spindle_speed_rev_s < 800.0 for n in range(200)) for t in loud.trials])
    force = np.mean([np.sum(np.mean(t.force_n**2, axis=0)) for t in dataset.trials])
    put_in = np.sqrt(count * 3 * amplitude_n**2 / 2 / force)
    assert above.left == pytest.approx(put_in, rel=0.15)
    assert above.measured > 0.8 * above.lines and above.calculated < 0.3 * above.measured
    assert f"{above.low_hz:.0f} to {above.high_hz:.0f} Hz" in str(above)


def test_the_verdict_and_the_report_tell_it(mill):
    found = trace(_ringing(mill(), 20.0), band_hz=BAND_HZ, effects=())
    assert "above the band compared, up to 1000 Hz" in found.verdict["remaining"]["description"]
    assert any(each.startswith("above the band compared") for each in found.caveats)
