"""Whole cuts in the virtual cell behind the policy server, on one clock: tracking, safety, hidden effects."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.export_check import ADDRESS, TICK_NS, Lockstep, check, checked
from mjx_cutting.deploy.observing import ACTIONS, NAMES
from mjx_cutting.deploy.protocol import Mode, State
from mjx_cutting.deploy.runtime import PolicyRuntime
from mjx_cutting.deploy.server import Server, Settings
from mjx_cutting.deploy.virtual_cell import Cell, CellConfig
from mjx_cutting.deploy.virtual_cell.follower import CLEARANCE_M, Phase
from mjx_cutting.deploy.virtual_cell.hidden import from_dict

LOW, HIGH = np.array([50.0, 50.0, 50.0, -0.8, 0.0]), np.array([3000.0, 3000.0, 3000.0, 1.0, 0.002])
BASELINE = (2450.0, 2080.0, 530.0, 0.0, 0.001)


def holding(set_point: tuple[float, ...] = BASELINE) -> Artefact:
    """A policy that asks for the same set-points whatever it sees."""
    log = np.array([True, True, True, False, False])
    low, high, now = (
        np.where(log, np.log(np.where(log, v, 1.0)), v) for v in (LOW, HIGH, np.array(set_point))
    )
    bias = np.arctanh(np.clip(2.0 * (now - low) / (high - low) - 1.0, -0.999999, 0.999999)).astype(np.float32)
    return Artefact(
        mean=np.zeros(15), std=np.ones(15), clip=5.0, layers=((np.zeros((15, 5)), bias),), activation="tanh",
        observation_names=NAMES, observation_units=("1",) * 15, observation_scales=(1.0,) * 15,
        action_names=ACTIONS, action_units=("s^-2", "s^-2", "s^-2", "1", "m"), action_low=tuple(LOW),
        action_high=tuple(HIGH), action_rate_per_s=(4.1, 4.1, 4.1, 2.0, 0.002),
        action_log=tuple(log.tolist()), action_initial=(*BASELINE[:4], 0.0), policy_period_s=0.02,
        golden_observation=np.zeros((1, 15)),
        golden_action=np.tanh(bias)[None],
    )  # fmt: skip


def make(effects: dict[str, Any] | None = None, **config: Any) -> Cell:
    settings = {"material": "plastic", "approach_m": 0.005, "cut_m": 0.02, **config}
    return Cell(CellConfig(**settings), from_dict(effects or {}))


def fly(cell: Cell) -> tuple[dict[str, Any], list[State], tuple[str, ...]]:
    heard: list[State] = []
    runtime = PolicyRuntime(holding())
    flight = Lockstep(cell, runtime, lambda t, state, s, k: heard.append(state)).fly(longest_s=20.0)
    return flight.score, heard, flight.log


@pytest.mark.parametrize("material", ["foam", "aluminium"])
def test_a_whole_cut(material: str) -> None:
    cell = make(material=material)
    score, heard, log = fly(cell)
    assert score["completed"] and log[-1] == "SAFE_STOP -> IDLE (FINISHED)"
    assert all(math.isfinite(v) for v in score.values() if isinstance(v, float))
    assert score["chips_mm3"] == pytest.approx(score["mrv_mm3"], rel=0.08)  # teeth against the swept circle
    depth = score["mrv_mm3"] / (1e9 * cell.config.kerf_m * cell.config.cut_m)
    assert 1e-5 < depth < 1.1e-3
    assert score["worst_deviation_mm"] < 8.0 and score["saturated_s"] == 0.0
    force = np.array([state.force_n for state in heard])
    assert np.isfinite(force).all() and abs(force[:, 0]).max() < 1.5
    # positions are the path's, minus the error reported
    last = heard[-1]
    wish = np.add(last.position_m, last.path_error_m)
    assert wish[1] == pytest.approx(cell.config.start_m[1] - last.path_m, abs=1e-9)
    assert cell.follower.phase is Phase.CLEAR
    assert cell.arm.tip_m[2] > cell.config.surface_m + 0.8 * CLEARANCE_M


def test_server_silence_stops_the_cell() -> None:
    """The server dies in the cut: the feed ramps to rest, the tool leaves the sheet, nothing restarts it."""
    cell = make(cut_m=0.05)
    server = Server(PolicyRuntime(holding()), Settings(), lambda line: None)
    now, died = 0, None
    for tick in range(8000):
        now += TICK_NS
        for data in cell.tick(now):
            answer = server.handle(data, ADDRESS, now) if died is None else None
            if answer:
                cell.receive(answer, now)
        if tick % 20 == 19 and died is None:
            command = server.tick(now)
            if command:
                cell.receive(command, now)
        if died is None and cell.follower.path_m > 0.02:
            died, path = now, cell.follower.path_m
        if cell.done:
            break
    assert died is not None and cell.done and cell.follower.why == "silence"
    hold_s = cell.follower.welcome.hold_us * 1e-6  # type: ignore[union-attr]
    assert cell.follower.path_m - path < 0.0125 * (hold_s + 0.55)
    assert cell.arm.tip_m[2] > cell.config.surface_m + 0.8 * CLEARANCE_M
    assert not cell.score.completed
    command = server.tick(now)
    assert command is not None
    cell.receive(command, now)  # RUNNING still, from a server that came back
    cell.tick(now + TICK_NS)
    assert cell.follower.phase is Phase.CLEAR


def test_out_of_range_and_stale_commands_are_ignored() -> None:
    cell = make()
    runtime = PolicyRuntime(holding())
    lockstep = Lockstep(cell, runtime)
    lockstep.fly(longest_s=1.0)
    before = cell.endpoint.counts["not mine"]
    replay = lockstep.server.tick(10**9)
    assert replay is not None
    cell.receive(replay, 10**9)
    cell.receive(replay, 10**9)
    cell.receive(replay[:-1], 10**9)
    cell.receive(replay[:60] + bytes([replay[60] ^ 1]) + replay[61:], 10**9)
    cell.tick(10**9)
    assert cell.endpoint.counts["not mine"] == before + 1
    assert cell.endpoint.counts["size"] == 1 and cell.endpoint.counts["crc"] == 1
    body = lockstep.cell.follower.welcome
    assert body is not None
    from mjx_cutting.deploy.protocol import Cause, Command

    wild = Command(1, Mode.RUNNING, Cause.NONE, 20_000, 100_000, 0, (9e3, 2080.0, 530.0, 0.0, 0.001))
    assert not cell.follower.command(wild, 10**9) and cell.follower.ignored == 1


def test_a_bad_cable_is_survived() -> None:
    score, _, log = fly(make({"network": {"loss": 0.1, "jitter_s": 0.004}}))
    assert score["completed"], log


def test_wear_lasts_over_the_session_and_a_new_tool_is_sharp() -> None:
    cell = make({"wear": {"per_m": 10.0}})
    lockstep = Lockstep(cell, PolicyRuntime(holding()))
    first = lockstep.fly().score["load_n"]
    second = lockstep.fly().score["load_n"]
    assert second > 1.01 * first
    assert Lockstep(make({"wear": {"per_m": 10.0}}), PolicyRuntime(holding())).fly().score["load_n"] == first


def force_line(effects: dict[str, Any], hz: float, **config: Any) -> float:
    """Amplitude of the feed force's line at `hz` in a steady stretch of the recorded samples."""
    _, heard, _ = fly(make(effects, cut_m=0.03, **config))
    wave = np.array([state.force_n[1] for state in heard])[-1000:]
    wave = wave - wave.mean()
    return 2.0 * abs(np.mean(wave * np.exp(-2j * np.pi * hz * np.arange(1000) * 2e-3)))


@pytest.mark.slow
def test_hidden_effects_show_in_the_samples() -> None:
    clean = {hz: force_line({}, hz) for hz in (2.5, 19.0)}
    assert force_line({"radial_runout": {"offset_m": 1.2e-5}}, 19.0) > 5.0 * clean[19.0]
    uneven = {"unequal_pitch": {"error_rad": (0.08 * np.sin(2 * np.pi * np.arange(20) / 20)).tolist()}}
    assert force_line(uneven, 19.0) > 5.0 * clean[19.0]
    ripple = {"material_periodicity": {"amplitude": 0.3, "wavelength_m": 0.005}}
    assert force_line(ripple, 2.5) > 2.0 * clean[2.5]  # 12.5 mm/s over 5 mm
    high, _, _ = fly(make({"sheet_pose": {"height_m": 2e-4}}))
    level, _, _ = fly(make())
    assert high["mrv_mm3"] > 1.1 * level["mrv_mm3"]


# -- the check before export


def test_check_passes_a_sound_policy_and_travels_with_it() -> None:
    artefact = checked(holding())
    verdict = artefact.provenance["sim_to_sim"]
    assert verdict["passed"] and [each["material"] for each in verdict["flights"]] == ["plastic", "aluminium"]
    assert all(each["completed"] and each["mrv_mm3"] > 0 for each in verdict["flights"])


def test_check_refuses_a_policy_that_leaves_its_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    from mjx_cutting.deploy import export_check

    monkeypatch.setitem(export_check.LIMITS, "worst_deviation_mm", 0.01)
    with pytest.raises(ValueError, match=r"worst_deviation_mm .* --allow-failed-check"):
        checked(holding(), cut_m=0.005)
    kept = checked(holding(), cut_m=0.005, allow_failed=True).provenance["sim_to_sim"]
    assert kept["passed"] is False and kept["reasons"]


def test_check_says_when_a_policy_cannot_be_flown() -> None:
    other = dataclasses.replace(holding(), observation_names=tuple(f"o{i}" for i in range(15)))
    verdict = check(other)
    assert verdict["passed"] is None and "observes o0" in verdict["reasons"][0]
