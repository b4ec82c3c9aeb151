"""A motor that gives way is named from what its spindle lost, and a spindle that only errs is not."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting.cutting import ForceModel, Material, Tool
from mjx_cutting.cutting.effects import SpindleDroop
from mjx_cutting.tracing import predict_trials, trace
from mjx_cutting.tracing.along.droop import CHANCE, _law
from mjx_cutting.tracing.fitting.believed_speeds import lines_as_it_turned
from mjx_cutting.tracing.fitting.prediction import loaded_about
from mjx_cutting.trials.dataset import AntiAlias, Dataset, Sensor, ToolInfo, Trial
from mjx_cutting.trials.synthetic import Conditions, Hidden, Sheet, make_trials

STATED = np.array([40.0, 40.0, 52.0, 52.0, 66.0, 66.0, 40.0, 52.0])
TORQUE = np.array([1.0, 3.0, 1.2, 2.5, 0.9, 2.0, 4.5, 4.0])


def test_the_law_of_the_losses_tells_the_motor_from_the_error_of_the_stated_speeds():
    scatter = 0.001 * STATED * np.random.default_rng(0).normal(size=len(STATED))
    law = _law(0.8 * TORQUE - 0.004 * STATED + scatter, TORQUE, STATED)
    assert abs(law.droop - 0.8) < 3.0 * law.spread < 0.2
    assert law.off == pytest.approx(0.004, abs=0.003)
    assert law.chance < CHANCE


def test_losses_that_do_not_go_with_the_torque_are_not_droop():
    chances = [
        _law(0.01 * STATED * np.random.default_rng(seed).normal(size=len(STATED)), TORQUE, STATED).chance
        for seed in range(300)
    ]
    assert np.mean(np.array(chances) < 0.05) < 0.09
    assert min(chances) > 0.1 * CHANCE


def test_losses_that_no_stated_speed_may_err_by_are_droop_though_they_scatter():
    off = np.array([0.9, -0.6, -0.2, 0.5, 0.3, 0.4, -0.9, 0.6])  # each within 1 %
    share = 0.0035 * TORQUE - 0.01 * off
    along = 0.02 + share  # every one slower by more than 1 %
    assert _law(share * STATED, TORQUE, STATED).chance > CHANCE
    assert along.min() > 0.01 and _law(along * STATED, TORQUE, STATED).chance < CHANCE


def test_speeds_stated_too_high_whatever_the_load_are_not_droop():
    scatter = 0.004 * np.random.default_rng(0).normal(size=len(STATED))
    assert _law((0.03 + scatter) * STATED, TORQUE, STATED).chance > CHANCE


def test_each_cut_is_slowed_by_the_torque_of_its_own_kind_of_milling(mill):
    """A slot among cuts of a fifth of the diameter, either way round."""
    dataset = mill()
    kinds = zip(dataset.trials, ("slot", "conventional", "climb") * 2, strict=True)
    trials = tuple(
        each if kind == "slot" else replace(each, milling=kind, radial_depth_m=0.2 * dataset.tool.diameter_m)
        for each, kind in kinds
    )
    shape = dataset.tool
    model = ForceModel(
        Tool(shape.kind, shape.teeth, shape.diameter_m), Material(8e8, 2e4, 0.0, 0.0, 0.0, 0.0)
    )
    model = model.with_effects(SpindleDroop(0.1))
    stated = np.array([each.spindle_speed_rev_s for each in trials])
    with jax.enable_x64(True):
        found = loaded_about(replace(dataset, trials=trials), model, stated)
        alone = [
            loaded_about(replace(dataset, trials=(each,)), model, np.array([speed]))[0]
            for each, speed in zip(trials, stated, strict=True)
        ]
    np.testing.assert_allclose(found, alone, rtol=1e-12)
    assert np.all(stated[1::3] - found[1::3] < 0.5 * (stated[0] - found[0]))


@pytest.mark.slow
def test_a_strong_vibration_is_not_taken_for_a_spindle_that_gives_way():
    case = make("mill", {"regenerative_chatter": "strong"}, 400)
    stated = [trial.spindle_speed_rev_s for trial in case.dataset.trials if trial.kind == "cut"]
    with jax.enable_x64(True):
        speeds = lines_as_it_turned(case.dataset, (0.0, 700.0)).speed_rev_s
    np.testing.assert_allclose(speeds, stated, rtol=0.0101)


def test_a_slow_spindle_is_believed_where_only_runout_shows_its_turns():
    """Tooth passing lies beyond the band, so the base model is told nothing by any speed."""
    stated = np.array([20.0, 16.0, 20.0, 20.0, 20.0, 20.0, 16.0, 16.0])
    chip = np.array([9e-6, 9e-6, 3e-6, 20e-6, 9e-6, 9e-6, 14e-6, 14e-6])
    depth = np.array([1.0, 1.0, 1.0, 1.0, 0.4, 2.0, 2.0, 2.0]) * 1e-3
    feed = 32 * stated * chip
    load = feed * depth
    loss = 0.09 * load / load.max() * stated.max() / stated
    turned = (1.0 - loss) * stated
    assert loss.max() > 0.08 and loss.min() > 0.005
    cuts = [Conditions(*each, 0.0012, "conventional") for each in zip(turned, feed, depth, strict=True)]
    sheet = Sheet((2.3e8, 1.1e8, 4e7), (8e3, 7e3, 2e3))
    sensor = Sensor(1000.0, (0.05,) * 3, anti_alias=AntiAlias(order=4, hz=250.0))
    tool, hidden = ToolInfo("slitting_saw", 32, 0.063), Hidden(runout_m=2e-6)
    made = make_trials(tool, sheet, cuts, sensor, hidden=hidden, duration_s=3.0, speed_error=0.0, seed=1)
    known = zip(made.trials, stated.tolist(), strict=True)
    dataset = replace(made, trials=tuple(replace(one, spindle_speed_rev_s=f) for one, f in known))
    with jax.enable_x64(True):
        speeds = lines_as_it_turned(dataset, (0.0, 250.0)).speed_rev_s
    np.testing.assert_allclose(speeds, turned, rtol=5e-3)


@pytest.mark.slow
def test_droop_is_named_with_its_stiffness_and_the_model_finds_the_speeds_again():
    case = make("mill", {"spindle_droop": "medium"}, 1)
    found = trace(case.dataset, effects=["spindle_droop"])
    (named,) = found.verdict["effects"]
    said = named["parameters"]["droop_rev_s_nm"]
    true = case.truth["effects"]["spindle_droop"]["droop_rev_s_nm"]
    assert named["name"] == "spindle_droop"
    assert said["low"] < true < said["high"] and said["value"] == pytest.approx(true, rel=0.03)
    after = found.verdict["after"]["heldout_nrmse"]
    assert after < 1.1 * found.verdict["noise_floor_nrmse"] < 0.2 * found.verdict["before"]["heldout_nrmse"]
    again = predict_trials(case.dataset, found.model)
    left = np.sqrt(sum(np.sum(p.residual_n**2) for p in again) / sum(np.sum(p.measured_n**2) for p in again))
    assert left < 1.2 * after


def _drilled(stiffness_nms: float, with_angle: bool) -> Dataset:
    """Ten holes at five feeds with a spindle that loses a revolution a second for every so many N m."""
    generator, trials = np.random.default_rng(0), []
    radius, rate_hz = 5e-3, 500.0
    time = np.arange(600) / rate_hz
    for index in range(10):
        nominal, feed = (25.0, 40.0)[index % 2], (2e-5, 5e-5, 1e-4, 1.6e-4, 2e-4)[index // 2]
        speed, push = nominal, nominal * feed
        for _ in range(20):
            torque = 2 * radius * (1.9e9 * push / (2 * speed) + 2e4) * radius / 2.0
            speed = nominal - torque / stiffness_nms
        thrust = 2 * radius * (1.2e9 * push / (2 * speed) + 3e4)
        force = np.full((600, 3), np.nan)
        force[:, 2] = thrust + generator.normal(0.0, 2.0, 600)
        trials.append(
            Trial(
                file=f"h{index}.csv",
                kind="cut",
                milling=None,
                spindle_speed_rev_s=nominal,
                feed_speed_m_s=push,
                radial_depth_m=radius,
                axial_width_m=radius,
                time_s=time,
                force_n=force,
                torque_nm=torque + generator.normal(0.0, 0.005, 600),
                spindle_angle_rad=2.0 * np.pi * speed * time + 1.0 if with_angle else None,
            )
        )
    sensor = Sensor(rate_hz, zeroed="session")
    return Dataset(name="holes", tool=ToolInfo("drill", 2, 2 * radius), sensor=sensor, trials=tuple(trials))


def test_a_drill_shows_droop_where_its_angle_was_measured():
    found = trace(_drilled(5.0, with_angle=True))
    (named,) = found.verdict["effects"]
    assert named["name"] == "spindle_droop" and found.verdict["verdict"] == "explained"
    assert named["parameters"]["droop_rev_s_nm"]["value"] == pytest.approx(0.2, rel=0.03)
    assert found.verdict["after"]["heldout_nrmse"] < 0.5 * found.verdict["before"]["heldout_nrmse"]


def test_a_drill_of_which_no_speed_was_measured_cannot_show_it():
    verdict = trace(_drilled(5.0, with_angle=False), effects=["spindle_droop"]).verdict
    assert verdict["effects"] == []
    needs = {each["name"]: each["needs"] for each in verdict["not_testable"]}
    assert needs["spindle_droop"] == "spindle angle or spindle speed"
    stiff = trace(_drilled(1e6, with_angle=True), effects=["spindle_droop"]).verdict
    assert stiff["verdict"] == "nothing missing" and stiff["effects"] == []
