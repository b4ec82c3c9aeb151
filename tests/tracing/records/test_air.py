"""Levels in air tie the bias of a sensor that was zeroed once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.problem import shared_bias
from mjx_cutting.tracing.records.air import air_levels
from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.tracing.records.levels import as_levels
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

RATE_HZ, SAMPLES, BIAS_N = 200.0, 400, 25.0


def _drilled(air: bool, zeroed="session") -> Dataset:
    """Four holes of one diameter at four feeds, thrust 25 N too high all through the session."""
    generator, trials = np.random.default_rng(1), []
    for index, feed in enumerate((5e-5, 1e-4, 2e-4, 3e-4, 2e-4)):
        kind = "air" if index == 4 else "cut"
        thrust = 0.0 if kind == "air" else 2 * 3e-3 * (1.5e9 * feed / 2 + 2e4)
        torque = 0.0 if kind == "air" else 2 * 3e-3 * (2e9 * feed / 2 + 1e4) * 1.5e-3
        force = np.full((SAMPLES, 3), np.nan)
        force[:, 2] = thrust + BIAS_N + generator.normal(0.0, 0.2, SAMPLES)
        trials.append(
            Trial(
                file=f"t{index}.csv",
                kind=kind,
                milling=None,
                spindle_speed_rev_s=20.0,
                feed_speed_m_s=feed * 20.0,
                radial_depth_m=3e-3,
                axial_width_m=3e-3,
                time_s=np.arange(SAMPLES) / RATE_HZ,
                force_n=force,
                torque_nm=torque + generator.normal(0.0, 0.001, SAMPLES),
            )
        )
    tool, sensor = ToolInfo("drill", 2, 6e-3), Sensor(RATE_HZ, (0.2, 0.001), zeroed=zeroed)
    kept = tuple(trial for trial in trials if air or trial.kind == "cut")
    return as_levels(Dataset(name="holes", tool=tool, sensor=sensor, trials=kept))


@pytest.mark.parametrize(("air", "edge_n_m"), [(True, 2e4), (False, 2e4 + BIAS_N / 6e-3)])
def test_with_a_cut_in_air_the_bias_is_not_taken_for_the_force_of_the_edge(posed, air, edge_n_m):
    with _platform.x64():
        _, problem = posed(_drilled(air))
        problem, found = fit_base(problem)
        bias_n = shared_bias(problem, found.x)
    assert abs(float(found.model.material.K_ae_n_m)) == pytest.approx(edge_n_m, rel=0.02)
    assert problem.shared_bias is air
    np.testing.assert_allclose(bias_n[2], BIAS_N * air, atol=0.5)


def test_air_says_nothing_of_a_sensor_that_is_zeroed_before_each_trial():
    dataset = _drilled(True, zeroed="trial")
    assert air_levels(dataset) is None and air_levels(_drilled(False)) is None
    with _platform.x64():
        found = air_levels(replace(dataset, sensor=replace(dataset.sensor, zeroed="session")))
    assert found is not None
    np.testing.assert_allclose(found.level_n[0], [0.0, 0.0, BIAS_N], atol=0.1)


@pytest.mark.parametrize(("share", "airs"), [(0.25, 1), (0.03, 2)])
def test_a_cut_that_ends_in_something_soft_does_not_end_in_the_air(turning_cut, share, airs):
    """The cut in air says what the sensor reads there; where it ends at a quarter of its force, it is not."""
    generator, cutting = np.random.default_rng(5), np.array([-40.0, 80.0, -15.0])
    zero = np.array([3.0, -5.0, 2.0])
    time = np.arange(500) / 500.0
    there = np.where(time < 0.6, 1.0, share)
    cut, air = (
        turning_cut(time, np.outer(of_it, cutting) + zero + generator.normal(0.0, 0.5, (500, 3)), file=file)
        for of_it, file in ((there, "1.csv"), (0.0 * time, "2.csv"))
    )
    trials = (cut, replace(air, kind="air"))
    made = Dataset(
        name="cuts", tool=ToolInfo("turning", 1, 0.03), sensor=Sensor(500.0, zeroed="session"), trials=trials
    )
    assert sum(trial.kind == "air" for trial in as_levels(made).trials) == airs


def test_a_zero_that_drifts_as_far_as_the_force_hides_no_beginning(turning_cut):
    """Once it has drifted, the record in the air is as large as in the cut; cuts in air say where zero is."""
    generator, cutting = np.random.default_rng(6), np.array([-40.0, 80.0, -15.0])
    time = np.arange(500) / 500.0
    there = np.clip((time - 0.3) / 0.01, 0.0, 1.0)
    trials = []
    for index in range(5):
        zero = index * np.array([14.0, -10.0, 8.0])
        force = np.outer(there * (index % 2), cutting) + zero + generator.normal(0.0, 0.5, (500, 3))
        kind = "cut" if index % 2 else "air"
        trials.append(
            replace(turning_cut(time, force, file=f"{index}.csv"), kind=kind, clock_start_s=60.0 * index)
        )
    sensor = Sensor(500.0, zeroed="session")
    made = Dataset(name="cuts", tool=ToolInfo("turning", 1, 0.03), sensor=sensor, trials=tuple(trials))
    for trial in (each for each in as_levels(made).trials if each.kind == "cut"):
        assert trial.time_s[0] >= 0.31
        np.testing.assert_allclose(
            np.ptp([part.mean(axis=0) for part in np.array_split(trial.force_n, 4)], axis=0), 0.0, atol=0.5
        )


def test_what_the_work_is_like_counts_from_where_each_cut_touches_it(turning_cut):
    """A bar with a hard ring, cut by records that begin in the air at places of their own."""
    generator, trials = np.random.default_rng(7), []
    for index, (touch_s, feed) in enumerate([(0.3, 1e-3), (0.5, 2e-3), (0.25, 3e-3)]):
        time = np.arange(0.0, touch_s + 0.006 / feed, 2e-3)
        place = feed * (time - touch_s)
        there = (place >= 0.0) * (1.0 + 0.3 * ((place > 2e-3) & (place < 3e-3)))
        force = np.outer(there, [-40.0, 80.0, -15.0]) + generator.normal(0.0, 0.5, (len(time), 3))
        trials.append(turning_cut(time, force, file=f"{index}.csv"))
        trials[-1] = replace(trials[-1], feed_speed_m_s=feed)
    tool, sensor = ToolInfo("turning", 1, 0.03), Sensor(500.0, zeroed="trial")
    for trial in as_levels(Dataset(name="cuts", tool=tool, sensor=sensor, trials=tuple(trials))).trials:
        hard = trial.force_n[:, 1] > 92.0
        np.testing.assert_allclose(along_path(trial)[hard][[0, -1]], [2e-3, 3e-3], atol=1e-5)
