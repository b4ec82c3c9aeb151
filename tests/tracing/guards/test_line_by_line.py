"""At one speed a resonance has to do as much as any gain of the lines could."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import effect_starts, fit_base
from mjx_cutting.tracing.fitting.heldout import folds
from mjx_cutting.tracing.guards.gain import Gain
from mjx_cutting.tracing.guards.line_by_line import rather_by_line
from mjx_cutting.tracing.naming.candidate import fitted
from mjx_cutting.trials.dataset import AntiAlias, Sensor, ToolInfo
from mjx_cutting.trials.synthetic import Conditions, Hidden, Sheet, make_trials

RESONANCE = effect_class("sensor_resonance")
MILL = ToolInfo("end_mill", 4, 0.016, 0.5)
SHEET = Sheet((8e8, 2.4e8, 1.2e8), (2e4, 1.6e4, 4e3))


def _slots(speeds, resonance_hz=0.0):
    cuts = [Conditions(v, v * 4 * chip, 0.016, 0.002) for v in speeds for chip in (2e-5, 5e-5, 1.2e-4)]
    sensor = Sensor(5000.0, (0.5, 0.5, 1.0), anti_alias=AntiAlias(order=4, hz=1000.0))
    hidden = Hidden(resonance_hz=resonance_hz)
    return make_trials(MILL, SHEET, cuts, sensor, hidden=hidden, duration_s=0.8, seed=4)


def _uneven(trial):
    """The trial with every fourth order stronger or weaker by a gain of its own."""
    spectrum = np.fft.rfft(trial.force_n, axis=0)
    frequency = np.fft.rfftfreq(len(trial.time_s), float(np.diff(trial.time_s).mean()))
    order = np.round(frequency / trial.spindle_speed_rev_s / 4.0).astype(int)
    gain = np.array([1.0, 1.0, 1.5, 0.6, 1.6, 0.7])[np.minimum(order, 5)]
    return replace(trial, force_n=np.fft.irfft(spectrum * gain[:, None], len(trial.time_s), axis=0))


@pytest.mark.parametrize(
    ("speeds", "resonance_hz", "uneven", "refused"),
    [
        ((50.0,), 0.0, True, True),
        ((50.0,), 620.0, False, False),
        ((40.0, 60.0), 620.0, False, False),
        ((40.0, 60.0), 0.0, True, False),
    ],
    ids=["lines of one speed", "resonance at one speed", "resonance at two", "left to other tests"],
)
def test_gains_of_lines_at_one_speed_are_not_called_a_resonance(posed, speeds, resonance_hz, uneven, refused):
    dataset = _slots(speeds, resonance_hz)
    if uneven:
        dataset = replace(dataset, trials=tuple(_uneven(trial) for trial in dataset.trials))
    with _platform.x64():
        lines, problem = posed(dataset)
        problem, base = fit_base(problem)
        starts = effect_starts(problem, RESONANCE, base.x)
        best = np.argmin(np.sum(Descent(problem, (RESONANCE,)).rows(np.asarray(starts)).left ** 2, axis=1))
        found, _ = fitted(problem, lines, (RESONANCE,), np.asarray(starts[best]), folds(dataset, 0))
        why = rather_by_line(Gain(problem, lines, (RESONANCE,), base, found))
    assert (why is not None) == refused
    assert why is None or "at one speed" in why
