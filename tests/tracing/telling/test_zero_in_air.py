"""A zero that differs between cuts in air is told where no effect of the model moves it."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest

from mjx_cutting.cutting import ForceModel, Material, Tool, effect_class
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.telling.zero_in_air import zero_in_air
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

LEVEL_N = np.array([-100.0, 200.0, -50.0])


def _trial(kind: str, force_n: np.ndarray, clock_s: float) -> Trial:
    time_s = np.arange(50) / 100.0
    return Trial(
        file=f"{kind}{clock_s:.0f}.csv",
        kind=kind,
        milling=None,
        spindle_speed_rev_s=15.0,
        feed_speed_m_s=1.5e-3,
        radial_depth_m=1e-3,
        axial_width_m=1e-3,
        clock_start_s=clock_s,
        time_s=time_s,
        force_n=np.tile(force_n, (50, 1)),
    )


def _turned(zeros_n, zeroed: str = "session") -> Dataset:
    """One cut and, at 0, 600, 1200... s, cuts in air that read `zeros_n`."""
    air = [_trial("air", np.asarray(each), 600.0 * index) for index, each in enumerate(zeros_n)]
    sensor = Sensor(100.0, (0.5, 0.5, 0.5), zeroed=zeroed)
    trials = (_trial("cut", LEVEL_N, 300.0), *air)
    return Dataset(name="turned", tool=ToolInfo("turning", 1, 0.05), sensor=sensor, trials=trials)


def _model(*effects) -> ForceModel:
    return ForceModel(Tool("turning", 1, 0.05), Material.from_n_mm(950, 16, 250, 19, 100, 5), effects)


ZEROS_N = [(0.0, 1.0, 0.0), (0.0, 9.0, 0.0), (0.0, 14.0, 1.0)]


def test_a_zero_that_moves_is_told_with_its_size_and_when():
    with jax.enable_x64(True):
        found = zero_in_air(_turned(ZEROS_N), _model())
    assert (found.axis, found.unit) == ("y", "N")
    assert found.moved == pytest.approx(13.0)
    assert found.share == pytest.approx(13.0 / np.linalg.norm(LEVEL_N))
    assert found.clocks_s == pytest.approx((0.245, 1200.245))
    assert "13 N more on y (5.7% of the force) at 1200 s" in str(found)


@pytest.mark.parametrize(
    ("dataset", "effects"),
    [
        (_turned(ZEROS_N, zeroed="trial"), ()),
        (_turned(ZEROS_N[:1]), ()),
        (_turned([(0.0, 1.0, 0.0), (0.0, 3.0, 0.0)]), ()),
        (
            _turned([(0.0, 20.0 * -np.expm1(-c / 600.0), 0.0) for c in (0.245, 600.245, 1200.245)]),
            (effect_class("thermal_drift")(np.array([0.0, 20.0, 0.0]), 600.0),),
        ),
    ],
    ids=["zeroed before each", "one cut in air", "less than 1 %", "the model has it"],
)
def test_a_zero_that_stays_or_that_the_model_moves_is_not(dataset, effects):
    with jax.enable_x64(True):
        assert zero_in_air(dataset, _model(*effects)) is None


def test_the_report_says_so_where_no_effect_is_named():
    """Six cuts of which nothing is missing, and a zero that jumps to and fro in air."""
    generator = np.random.default_rng(0)
    trials = []
    for index in range(6):
        feed, width = (1.0, 2.0, 3.0)[index % 3], (1.0, 1.5)[index // 3]
        cut = _trial("cut", width * (0.5 + 0.25 * feed) * LEVEL_N, 200.0 * index)
        noisy = cut.force_n + generator.normal(0.0, 0.5, cut.force_n.shape)
        trials.append(replace(cut, force_n=noisy, feed_speed_m_s=feed * 1.5e-3, axial_width_m=width * 1e-3))
    for index, zero in enumerate([(0.0, 0.0, 0.0), (0.0, 15.0, 0.0), (0.0, 0.0, 0.0)]):
        air = _trial("air", np.asarray(zero), 50.0 + 500.0 * index)
        trials.append(replace(air, force_n=air.force_n + generator.normal(0.0, 0.5, air.force_n.shape)))
    found = trace(replace(_turned([]), trials=tuple(trials)))
    assert any("its zero drifts, or something moved it" in each for each in found.caveats)
    assert "its zero drifts" in found.verdict["remaining"]["description"]
