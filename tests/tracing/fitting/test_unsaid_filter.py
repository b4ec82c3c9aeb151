"""A filter before sampling that nobody declared is not taken for a low-pass of the sensor."""

from __future__ import annotations

from dataclasses import replace

import jax
import pytest

from mjx_cutting.tracing import trace
from mjx_cutting.tracing.fitting.unsaid_filter import as_filtered
from mjx_cutting.trials.dataset import AntiAlias, Dataset, Sensor, ToolInfo
from mjx_cutting.trials.synthetic import Conditions, Hidden, Sheet, make_trials

RATE_HZ, TEETH = 4000.0, 20
STEEP = AntiAlias(order=10, hz=0.45 * RATE_HZ, zero_phase=True)


def _session(alias: AntiAlias | None) -> Dataset:
    cuts = [
        Conditions(speed, TEETH * speed * chip, depth, 0.0015, "conventional")
        for speed, chip, depth in [
            (20.1, 3e-5, 1e-3), (19.9, 6e-5, 1e-3), (20.0, 1.2e-4, 1e-3), (15.1, 8e-5, 1e-3),
            (27.0, 5e-5, 1e-3), (20.05, 6e-5, 2e-3),
        ]
    ]  # fmt: skip
    sheet, sensor = Sheet((8e8, 3e8, 1e8), (1.2e4, 8e3, 2e3)), Sensor(RATE_HZ, (0.15,) * 3, anti_alias=alias)
    tool = ToolInfo("slitting_saw", TEETH, 0.05)
    made = make_trials(tool, sheet, cuts, sensor, hidden=Hidden(), duration_s=0.9, speed_error=0.0, seed=3)
    return replace(made, sensor=replace(sensor, anti_alias=None))


def _filter_of(session: Dataset) -> AntiAlias | None:
    with jax.enable_x64(True):
        found, band_hz, said = as_filtered(session, None)
    alias = found.sensor.anti_alias
    assert bool(said) == (band_hz is not None) == (alias is not None)
    assert alias is None or band_hz == (0.0, 0.75 * alias.hz)
    return alias


def test_records_that_lack_what_would_fold_into_them_stand_behind_a_filter():
    found = _filter_of(_session(STEEP))
    assert found is not None and 0.4 * RATE_HZ <= found.hz <= 0.48 * RATE_HZ


def test_records_into_which_lines_fold_stand_behind_none():
    assert _filter_of(_session(None)) is None


def test_a_filter_that_is_declared_stays():
    session = _session(STEEP)
    declared = replace(session, sensor=replace(session.sensor, anti_alias=STEEP))
    with jax.enable_x64(True):
        assert as_filtered(declared, None) == (declared, None, ())


@pytest.mark.slow
def test_no_low_pass_is_named_for_the_filter_of_the_acquisition():
    found = trace(_session(STEEP), effects=("sensor_lowpass", "torque_ripple"))
    assert found.verdict["verdict"] == "nothing missing"
    assert any("declare the one that the acquisition has" in said for said in found.caveats)
