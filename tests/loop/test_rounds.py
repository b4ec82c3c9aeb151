"""Rounds of the closed loop: probes, recording, steady stretches, the reward, and one whole round."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.observing import ACTIONS, NAMES
from mjx_cutting.deploy.runtime import PolicyRuntime
from mjx_cutting.deploy.virtual_cell import Cell, CellConfig
from mjx_cutting.loop import rounds, rounds_record
from mjx_cutting.sim.config import EnvConfig
from mjx_cutting.trials import read
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

LOW, HIGH = (50.0, 50.0, 50.0, -0.8, 0.0), (3000.0, 3000.0, 3000.0, 1.0, 0.002)


@pytest.fixture
def like() -> Artefact:
    return Artefact(
        mean=np.zeros(15), std=np.ones(15), clip=5.0,
        layers=((np.ones((15, 5)), np.zeros(5)),), activation="tanh", observation_names=NAMES,
        observation_units=("1",) * 15, observation_scales=(1.0,) * 15, action_names=ACTIONS,
        action_units=("s^-2", "s^-2", "s^-2", "1", "m"), action_low=LOW, action_high=HIGH,
        action_rate_per_s=(4.1, 4.1, 4.1, 2.0, 0.002), action_log=(True, True, True, False, False),
        action_initial=(2450.0, 2080.0, 530.0, 0.0, 0.0), policy_period_s=0.02,
        golden_observation=np.zeros((2, 15)), golden_action=np.zeros((2, 5)),
    )  # fmt: skip


def test_a_probe_holds_its_set_points(like: Artefact) -> None:
    wanted = (2450.0, 100.0, 1060.0, -0.5, 0.0012)
    runtime = PolicyRuntime(rounds_record.probe(like, wanted))
    for observation in (np.zeros(15), np.full(15, 3.0)):
        assert runtime.set_point(runtime(observation)) == pytest.approx(wanted, rel=1e-4)
    asked = {tuple(p.provenance["probe"][3:]) for p in rounds_record.probes(like, 9, seed=1)}
    assert len(asked) == 9 and {feed for feed, _ in asked} == set(rounds_record.FEEDS)


def trial(depth_m: np.ndarray, feed_m_s: np.ndarray) -> Trial:
    count = len(depth_m)
    position = np.zeros((count, 3))
    position[:, 2] = 0.11 - depth_m
    return Trial(
        file="a.parquet", kind="cut", milling="conventional", spindle_speed_rev_s=19.0, feed_speed_m_s=0.0125,
        radial_depth_m=0.002, axial_width_m=1.6e-3, time_s=np.arange(count) / 500.0,
        force_n=np.random.default_rng(0).normal(size=(count, 3)), position_m=position,
        feed_speed_measured_m_s=feed_m_s,
    )  # fmt: skip


def dataset(*trials: Trial) -> Dataset:
    tool, sensor = ToolInfo("slitting_saw", 20, 0.05), Sensor(500.0)
    return Dataset(name="x", source="made", licence="none", tool=tool, sensor=sensor, trials=trials)


def test_the_steady_stretch_has_the_measured_depth() -> None:
    settling = np.concatenate([np.linspace(2e-3, 5e-4, 600), np.full(1500, 5e-4)])
    (found,) = rounds_record.steady(dataset(trial(settling, np.full(2100, 0.011))), 0.11).trials
    assert found.radial_depth_m == pytest.approx(5e-4, rel=0.05) and found.feed_speed_m_s == pytest.approx(
        0.011
    )
    assert 1200 < len(found.time_s) < 1600 and found.time_s[0] == 0.0
    restless = 1e-3 + 5e-4 * np.sin(np.arange(2100) / 150.0)
    assert rounds_record.steady(dataset(trial(restless, np.full(2100, 0.011))), 0.11).trials == ()


def test_reward_is_the_simulations() -> None:
    env = EnvConfig()
    score = {
        "mrv_mm3": 100.0, "time_s": 10.0, "error_squared_mm2_s": [1.0, 20.0, 3.0],
        "force_squared_n2_s": [0.0, 400.0, 100.0], "why": "finished",
    }  # fmt: skip
    expected = 100.0 * 1e-3 - 10.0 * 0.05 - 24.0 * 1e-4 - 500.0 * 5e-5
    assert rounds.reward(env, score) == pytest.approx(expected)
    assert rounds.reward(env, {**score, "why": "force"}) == pytest.approx(expected + env.failure_reward)


def test_settings_out_of_range() -> None:
    for wrong in ({"rounds": 0}, {"trials": 21}, {"trials": 1}, {"cuts": 0}, {"candidates": ()}):
        with pytest.raises(ValueError, match="expected"):
            rounds.RoundsConfig(**wrong)  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize("udp", [False, True])
def test_recorded_trials_open_as_a_dataset(udp: bool, like: Artefact, tmp_path: Path) -> None:
    cell = Cell(CellConfig(material="plastic", approach_m=0.003, cut_m=0.03))
    record = rounds_record.record_udp if udp else rounds_record.record
    folder = tmp_path / "d"
    for attempt in range(3 if udp else 1):  # a busy machine may miss the server's limits in real time
        folder = tmp_path / f"d{attempt}"
        if attempt:
            cell.new_trial()
        flights = record(cell, rounds_record.probes(like, 2, seed=2)[:1], folder, "a session")
        if flights[0].score["completed"]:
            break
    assert flights[0].score["completed"], flights[0].log
    found = read(folder)
    kinds = [each.kind for each in found.trials]
    assert "cut" in kinds and found.tool.teeth == 20
    (cut,) = [each for each in found.trials if each.kind == "cut"]
    assert cut.spindle_angle_rad is not None and cut.force_n[:, 0].mean() < -0.5  # against the feed


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_one_round(tmp_path: Path) -> None:
    effects = tmp_path / "hidden.toml"
    effects.write_text("[radial_runout]\noffset_m = 1.2e-5\n")
    config = rounds.RoundsConfig(
        out=tmp_path / "out", material="plastic", effects=effects, rounds=1, trials=3, cuts=1,
        candidates=("radial_runout",), preset="smoke", quiet=True,
    )  # fmt: skip
    folder = rounds.run(config)
    (told,) = json.loads((folder / "rounds.json").read_text())["rounds"]
    assert told["named"] == ["radial_runout"]
    assert told["heldout_nrmse_after"] < 0.8 * told["heldout_nrmse_before"]
    assert set(told["reward"]) == set(rounds.STRATEGIES)
    for name in rounds.STRATEGIES:
        assert told["scores"][name][0]["completed"] and np.isfinite(told["reward"][name])
        assert Artefact.load(folder / "round1" / f"{name}.npz").golden_action.size
    assert set(told["effects"]) == {"radial_runout"}
    offset = told["effects"]["radial_runout"]["offset_m"]  # the arm follows it: the measured path tells it
    assert offset["value"] == pytest.approx(1.2e-5, rel=0.15)
    assert "radial_runout" in rounds.table([told])
