"""Records that begin before the sheet: its edge is found, and everything else is traced inside it."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting import _platform
from mjx_cutting.cutting import ForceModel, effect_class
from mjx_cutting.tracing.along.ends import Ramps, entry_exit
from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.problem import pose
from mjx_cutting.tracing.records.course import Course, along_path
from mjx_cutting.tracing.records.lines import compress, trusted_band
from mjx_cutting.tracing.sheet import _at_one_place, _zeroed_in_air
from mjx_cutting.tracing.trace import trace

START_M, END_M = 1e-3, 30e-3


def test_force_missing_on_the_ramps_is_that_of_the_effect(mill):
    """Lines of shortened arcs, interpolated, mean the same over a turn as the force path with both ends."""
    with _platform.x64():
        dataset = mill()
        lines = compress(dataset, trusted_band(dataset, None))
        problem, base = fit_base(pose(dataset, lines))
        ramps = Ramps(lines, problem, base.model)
        reach = float(ramps.reach_m[0])
        turn = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
        bare = ForceModel(problem.tool, base.model.material)
        ends = bare.with_effects(effect_class("entry_exit")(1.0, START_M, END_M - START_M))
        cut = jax.tree.map(lambda leaf: leaf[0] + 0.0 * turn, problem.cut)
        whole = np.abs(np.asarray(bare.process_force(cut.replace(angle_rad=turn))).mean(axis=0)).max()
        for place in START_M + reach * np.array([-0.2, 0.02, 0.3, 0.77, 1.5, 3.0, 4.2]):
            here = cut.replace(angle_rad=turn, position_m=place + 0.0 * turn, gate_rad=turn[1] + 0.0 * turn)
            expected = np.asarray(ends.process_force(here) - bare.process_force(here)).mean(axis=0)
            silent = np.zeros((len(turn), 3))
            course = Course(
                turn, 0.0 * turn + place, None, silent, silent, silent, 360.0, (0.0, 180.0), angle_rad=turn
            )
            found = ramps.missing(course, START_M, END_M).mean(axis=0)
            np.testing.assert_allclose(found, expected, atol=0.01 * whole)


def test_a_bias_is_read_where_the_tool_is_not_yet_in_the_sheet(mill):
    dataset = mill(zeroed="trial")
    shifted = [replace(t, force_n=t.force_n + np.array([5.0, -3.0, 1.0])) for t in dataset.trials]
    dataset = replace(dataset, trials=tuple(shifted))
    zeroed = _zeroed_in_air(dataset, np.full(len(shifted), 1.6e-3))
    assert zeroed.sensor.zeroed == "session"
    for trial in zeroed.trials:
        air = along_path(trial) < 1.6e-3
        np.testing.assert_allclose(trial.force_n[air].mean(axis=0), 0.0, atol=1e-9)
    assert _zeroed_in_air(dataset, np.zeros(len(shifted))) is dataset


@pytest.mark.slow
@pytest.mark.parametrize("design", ["mill", "saw"])
def test_the_edge_of_the_sheet_is_named_with_its_place(design, names_the_edge):
    """Traced inside, what is left is the floor; the whole records then show the geometry, share one."""
    case = make(design, {"entry_exit": "medium"}, 46 if design == "saw" else 45)
    names = ["radial_runout", "entry_exit", "layered_material"]
    found = trace(case.dataset, effects=names).verdict
    names_the_edge(found, case.truth["effects"]["entry_exit"]["start_m"])


@pytest.mark.parametrize(("share", "named"), [(1.0, True), (0.5, True), (0.08, False)])
def test_a_small_part_of_the_force_missing_at_the_ends_is_not_the_sheet(mill, posed, share, named):
    """What a drive does as it begins to move comes to some hundredths of the force."""
    with jax.enable_x64(True):
        lines, problem = posed(mill())
        problem, base = fit_base(problem)
        kind = entry_exit(lines, problem, base.model)
    why = kind.rather([], kind.build(np.array([1e-3, np.inf, 0.0]), np.array([share])))
    assert (why == "") == named
    assert named or "8%" in why


@pytest.mark.slow
def test_a_layer_does_not_spoil_the_constants_it_is_measured_by():
    """A layer that takes three quarters of the force over a fifth of the path comes out with its size."""
    case = make("mill", {"layered_material": "strong"}, 53)
    found = trace(case.dataset, effects=["radial_runout", "layered_material"]).verdict
    (effect,) = found["effects"]
    truth = case.truth["effects"]["layered_material"]
    assert effect["parameters"]["change"]["value"] == pytest.approx(truth["change"], abs=0.02)
    assert found["after"]["heldout_nrmse"] < 0.15 * found["before"]["heldout_nrmse"]


@pytest.mark.parametrize(("apart_m", "one_place"), [(0.0, True), (0.004, False)])
def test_sheets_clamped_anew_begin_nowhere_in_particular(mill, apart_m, one_place):
    made, trials = mill(), []
    places = 0.02 + apart_m * np.array([0.0, 1.0, -1.0, 2.0, -2.0, 1.5])
    for trial, place in zip(made.trials, places, strict=True):
        along = np.linspace(0.0, 0.08, len(trial.time_s))
        force = np.where(along[:, None] > place, trial.force_n, 0.0)
        position = along[:, None] * np.array([1.0, 0.0, 0.0])
        trials.append(replace(trial, force_n=force, position_m=position))
    dataset = replace(made, trials=tuple(trials))
    reach_m = np.full(6, 0.008)
    assert _at_one_place(dataset, 0.02 + 0.0 * places, reach_m) == one_place
    # many teeth at a fine feed rise slowly: seen a third of the way in, at one place all the same
    assert _at_one_place(dataset, 0.02 - 0.3 * reach_m, reach_m) == one_place
    # what never shows its air says nothing of it
    assert _at_one_place(made, places, reach_m)
