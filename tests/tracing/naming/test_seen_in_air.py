"""A zero that moves in air as an effect has it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from mjx_cutting.cutting import ForceModel, Material, Tool
from mjx_cutting.cutting.effects.thermal_drift import ThermalDrift
from mjx_cutting.tracing.naming.seen_in_air import seen_in_air
from mjx_cutting.tracing.records.air import air_levels
from mjx_cutting.trials.dataset import Sensor

DRIFT = ThermalDrift(drift_n=np.array([3.0, -8.0, 40.0]), tau_s=600.0)
CLOCKS_S = (30.0, 200.0, 420.0, 800.0, 1100.0, 1500.0)


@pytest.fixture
def seen(mill):
    """Call it with what the zero is, [3] at a clock, and the model said to explain it."""

    def ask(zero_n, effect, clocks_s=CLOCKS_S) -> bool:
        made, generator = mill(), np.random.default_rng(4)
        first = made.trials[0]
        airs = tuple(
            replace(
                first, file=f"air{clock:.0f}.csv", kind="air", clock_start_s=clock,
                force_n=zero_n(clock) + generator.normal(0.0, 0.5, first.force_n.shape),
            )
            for clock in clocks_s
        )  # fmt: skip
        dataset = replace(made, sensor=Sensor(5000.0, zeroed="session"), trials=(*made.trials, *airs))
        problem = SimpleNamespace(air=air_levels(dataset), weight=np.ones(3), alive=(True, True, True))
        bare = ForceModel(
            Tool("end_mill", 4, 0.016), Material(K_tc_n_m2=8e8, K_te_n_m=2e4, K_rc_n_m2=2.4e8, K_re_n_m=8e3)
        )
        before, after = (SimpleNamespace(model=each) for each in (bare, bare.with_effects(effect)))
        return seen_in_air(problem, before, after, added=4, tries=10)

    return ask


def _drifted(clock_s: float) -> np.ndarray:
    return 20.0 + DRIFT.drift_n * -np.expm1(-clock_s / DRIFT.tau_s)


def test_a_drift_is_seen_whatever_the_zero_it_began_at(seen):
    assert seen(_drifted, DRIFT)


def test_another_drift_than_that_of_the_records_is_not(seen):
    assert not seen(_drifted, replace(DRIFT, drift_n=-DRIFT.drift_n))


def test_a_zero_that_jumps_about_is_no_drift(seen):
    jumps = dict(zip(CLOCKS_S, np.random.default_rng(5).normal(0.0, 15.0, (6, 3)), strict=True))
    assert not seen(lambda clock: jumps[clock], DRIFT)


def test_two_levels_in_air_prove_nothing(seen):
    assert not seen(_drifted, DRIFT, CLOCKS_S[1:4:2])


def test_without_air_nothing_is_seen():
    assert not seen_in_air(SimpleNamespace(air=None), None, None, added=4, tries=1)
