"""Circles or the true path of the teeth: the trials say which, and nothing is named for it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, order_lines
from mjx_cutting.cutting.effects.radial_runout import RadialRunout
from mjx_cutting.cutting.effects.tooth_path import ToothPath
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.tooth_path import TruePathInArc, TrueToothPath, on_other_path, on_true_path
from mjx_cutting.trials.dataset import AntiAlias, Sensor, ToolInfo
from mjx_cutting.trials.synthetic import Conditions, Hidden, Sheet, make_trials, one_turn

TOOL = ToolInfo("end_mill", 3, 0.01)
SHEET = Sheet((8e8, 2.4e8, 1.2e8), (2e4, 1.6e4, 4e3))
CHIPS_M = (5e-5, 1e-4, 2e-4)


@pytest.fixture(autouse=True)
def float64() -> Iterator[None]:
    with _platform.x64():
        yield


def trials(hidden: Hidden, tool: ToolInfo = TOOL):
    cuts = [
        Conditions(speed, speed * tool.teeth * chip, depth, 0.002, "climb")
        for speed, depth in ((40.0, 0.004), (55.0, 0.007))
        for chip in CHIPS_M
    ]
    sensor = Sensor(5000.0, (0.3, 0.3, 0.6), anti_alias=AntiAlias(order=4, hz=1500.0))
    return make_trials(tool, SHEET, cuts, sensor, hidden=hidden, duration_s=0.6, seed=5)


@pytest.mark.parametrize("milling", ["slot", "conventional", "climb"])
@pytest.mark.parametrize("runout_m", [0.0, 3e-5])
@pytest.mark.parametrize("cusps", [False, True])
def test_the_closed_form_is_the_path_found_by_iteration(milling: str, runout_m: float, cusps: bool):
    """To 1e-3 of the largest line at a feed per tooth of 4 % of the radius, where circles are off by five
    times that and more."""
    cut = Conditions(40.0, 40.0 * 3 * 2e-4, 0.006, 0.002, milling)
    hidden = Hidden(runout_m=runout_m, true_path=True, cusps=cusps)
    exact = np.fft.rfft(one_turn(TOOL, SHEET, cut, hidden), axis=0)[:31]
    exact = np.abs(exact) / 7200
    tool = Tool("end_mill", 3, TOOL.diameter_m)
    material = Material(*np.stack([SHEET.chip_n_m2, SHEET.edge_n_m], axis=1).ravel())
    here = Cut.milling(
        milling,
        TOOL.diameter_m,
        angle_rad=0.0,
        spindle_speed_rev_s=40.0,
        feed_speed_m_s=cut.feed_speed_m_s,
        radial_depth_m=cut.radial_depth_m,
        axial_width_m=cut.axial_width_m,
    )

    def off(*effects) -> float:
        model = ForceModel(tool, material, (RadialRunout(runout_m, 0.0), *effects))
        return float(np.max(np.abs(np.abs(order_lines(model, here, 30, 720)) - exact)) / exact.max())

    assert off(ToothPath(1.0, float(cusps))) < 1e-3
    assert off(ToothPath(1.0, float(not cusps))) > 1.5e-3
    assert off() > 5e-3


@pytest.mark.parametrize(("true_path", "cusps"), [(False, False), (True, False), (True, True)])
def test_the_trials_say_on_which_path_the_teeth_go(posed, true_path: bool, cusps: bool):
    _, problem = posed(trials(Hidden(true_path=true_path, cusps=cusps)))
    problem, base = fit_base(problem)
    other = on_other_path(problem, (), base.x)
    assert (other is not None) is true_path
    if other is not None:
        assert on_true_path(other) and other.given == (TrueToothPath if cusps else TruePathInArc,)
        problem, moved = fit_base(other)
        assert float(moved.error_n2.sum()) < 0.5 * float(base.error_n2.sum())
        assert on_other_path(problem, (), moved.x) is None


def test_from_the_true_path_back_to_circles(posed):
    _, on_circles = posed(trials(Hidden()))
    _, there = posed(trials(Hidden(true_path=True)))
    there, base = fit_base(there)
    true = on_other_path(there, (), base.x)
    assert true is not None
    problem, fit = fit_base(replace(on_circles, given=true.given))
    back = on_other_path(problem, (), fit.x)
    assert back is not None and not on_true_path(back)


def test_a_feed_that_is_small_against_the_radius_is_not_asked_about(posed):
    _, problem = posed(trials(Hidden(true_path=True), ToolInfo("end_mill", 3, 0.2)))
    problem, base = fit_base(problem)
    assert on_other_path(problem, (), base.x) is None


def test_beside_uneven_teeth_a_smaller_feed_is_asked_about(posed):
    """They meet surfaces left a whole turn before: cusps 20 times as long on a saw of 20 teeth."""
    saw = ToolInfo("slitting_saw", 20, 0.063)
    cuts = [
        Conditions(speed, feed, depth, 0.0016, "conventional")
        for speed, feed, depth in ((30.0, 0.006, 0.0015), (40.0, 0.006, 0.003), (40.0, 0.02, 0.0015))
    ]
    hidden = Hidden(runout_m=2.6e-6, runout_angle_rad=0.9, true_path=True, cusps=True)
    _, problem = posed(make_trials(saw, SHEET, cuts, Sensor(5000.0, (0.2,) * 3), hidden=hidden, seed=5))
    problem, base = fit_base(problem)
    assert on_other_path(problem, (), base.x) is None
    x, _ = Descent(problem, (RadialRunout,)).descend(np.append(np.asarray(base.x), [0.2, 0.1]), 20)
    other = on_other_path(problem, (RadialRunout,), x)
    assert other is not None and other.given == (TrueToothPath,)


@pytest.mark.slow
@pytest.mark.parametrize(("runout_m", "cusps"), [(0.0, False), (0.0, True), (1.5e-5, True)])
def test_a_large_feed_is_no_missing_effect(runout_m: float, cusps: bool):
    found = trace(trials(Hidden(runout_m=runout_m, runout_angle_rad=0.4, true_path=True, cusps=cusps)))
    assert [each["name"] for each in found.verdict["effects"]] == ["radial_runout"] * (runout_m > 0.0)
    assert found.verdict["verdict"] == ("explained" if runout_m else "nothing missing")
    assert any(isinstance(each, ToothPath) for each in found.model.effects)
    assert any("true path" in caveat for caveat in found.caveats)
