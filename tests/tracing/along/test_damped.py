"""Process damping is found where records hold the tool's vibration, of each tooth or of the tool as one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from benchmarks.study import make
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.records.course import along_path, beside_path
from mjx_cutting.tracing.telling.verdict import not_testable
from mjx_cutting.trials.dataset import Dataset, Trial
from mjx_cutting.trials.synthetic import Conditions, make_trials

FILTER = signal.butter(4, 1000.0, fs=5000.0, output="sos")
TRIED = ("process_damping", "hysteresis", "crosstalk", "radial_runout")


def _shaken(trial: Trial, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Place across the path, m, and its rate, m/s."""
    turn = 2.0 * np.pi * (90.0 + 20.0 * index)
    return 1e-5 * np.sin(turn * trial.time_s), 1e-5 * turn * np.cos(turn * trial.time_s)


def _with_vibration(dataset: Dataset, damping_n_m: float) -> Dataset:
    """The trials with a measured place across the path alone, and the force on the tool as one."""
    trials = []
    for index, each in enumerate(dataset.trials):
        place, rate = _shaken(each, index)
        position, force = np.zeros((each.samples, 3)), each.force_n.copy()
        position[:, 1] = place + 1e-8 * np.random.default_rng(index).normal(size=each.samples)
        cutting = np.pi * dataset.tool.diameter_m * each.spindle_speed_rev_s
        force[:, 1] -= damping_n_m * each.axial_width_m * signal.sosfilt(FILTER, rate) / cutting
        trials.append(replace(each, position_m=position, force_n=force))
    return replace(dataset, trials=tuple(trials))


@pytest.fixture(scope="module")
def shaken(mill, mill_sheet) -> Dataset:
    """Shallow cuts: in a slot four teeth together damp as the tool does."""
    cuts = [
        Conditions(speed, speed * 4 * chip, 0.003, 0.002, "conventional")
        for speed in (25.0, 40.0)
        for chip in (3e-5, 6e-5, 1.2e-4)
    ]
    like = mill()
    return make_trials(like.tool, mill_sheet, cuts, like.sensor, duration_s=0.8, seed=4)


def test_damping_of_the_tool_as_one_is_named(shaken):
    found = trace(_with_vibration(shaken, 6e5), effects=TRIED)
    (effect,) = found.verdict["effects"]
    assert effect["name"] == "process_damping"
    told = effect["parameters"]
    assert told["of_tool"]["value"] == 1.0
    assert told["damping_n_m"]["low"] < 6e5 < told["damping_n_m"]["high"]
    assert found.verdict["after"]["heldout_nrmse"] < 1.3 * found.verdict["noise_floor_nrmse"]


def test_a_vibration_that_nothing_damps_is_nothing_missing(shaken):
    verdict = trace(_with_vibration(shaken, 0.0), effects=TRIED).verdict
    assert verdict["verdict"] == "nothing missing"


@pytest.mark.parametrize("design", ["mill", "saw"])
def test_damping_of_each_tooth_is_named(design):
    case = make(design, {"process_damping": "medium"}, 405)
    (effect,) = trace(case.dataset, effects=TRIED).verdict["effects"]
    assert effect["name"] == "process_damping"
    told, true = effect["parameters"], case.truth["effects"]["process_damping"]["damping_n_m"]
    assert told["of_tool"]["value"] == 0.0
    assert told["damping_n_m"]["value"] == pytest.approx(true, rel=0.1)


def test_without_the_place_across_the_path_it_is_not_testable(shaken):
    def missing(dataset: Dataset) -> set[str]:
        return {each["name"] for each in not_testable(dataset)}

    assert "process_damping" in missing(shaken)
    assert "process_damping" not in missing(_with_vibration(shaken, 0.0))


def test_a_place_across_the_path_is_not_taken_for_the_path(shaken):
    """What moves by far less than was fed, nothing else measured, is beside it; what moves most is it."""
    trial = _with_vibration(shaken, 0.0).trials[0]
    np.testing.assert_allclose(along_path(trial), trial.feed_speed_m_s * trial.time_s)
    np.testing.assert_allclose(beside_path(trial, None, 0.0), _shaken(trial, 0)[0], atol=1e-7)
    along_y = np.zeros((trial.samples, 3))
    along_y[:, 1] = trial.feed_speed_m_s * trial.time_s
    trial = replace(trial, position_m=along_y)
    assert beside_path(trial, None, 0.0) is None
    assert beside_path(trial, ("+y", "+x", "+z"), 0.0) is None
    np.testing.assert_allclose(along_path(trial), along_y[:, 1])
