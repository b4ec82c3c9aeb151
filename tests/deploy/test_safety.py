"""The state machine: nothing moves unarmed, all stops are ramps, a fault is left by re-arming alone."""

from __future__ import annotations

import dataclasses
import itertools
import random

import numpy as np
import pytest

from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.protocol import Cause, Mode, Robot, State
from mjx_cutting.deploy.safety import Limits, Safety, plausible

READY = State(
    Robot.READY,
    1,
    (0.0, 0.0, 0.0),
    (0.0, 0.0, 0.0),
    (0.5, 0.3, 0.1),
    (1.0, 0.0, 0.0),
    0.0,
    0.0,
    0.0,
    0.0,
    0.0,
)


@pytest.fixture
def safety(served: Artefact) -> Safety:
    return Safety(served, Limits(), log=lambda line: None)


def running(safety: Safety) -> Safety:
    safety.sample(READY)
    safety.arm(0.0)
    safety.start()
    for _ in range(100):
        safety.advance(None)
    assert safety.mode is Mode.RUNNING and safety.policy_acts
    return safety


def settle(safety: Safety, steps: int = 200) -> None:
    for _ in range(steps):
        safety.advance(None)


def test_start_without_arming_moves_nothing(safety: Safety, served: Artefact) -> None:
    safety.sample(READY)
    safety.start()
    for _ in range(50):
        safety.advance(np.asarray(served.action_high))
    assert safety.mode is Mode.IDLE
    assert safety.set_point[3] == -1.0 and safety.set_point[4] == served.action_low[4]


def test_run_up_and_stop_keep_to_the_rates(safety: Safety, served: Artefact) -> None:
    safety.sample(READY)
    safety.arm(0.0)
    safety.start()
    points = [safety.set_point]
    for step in range(300):
        if step == 150:
            safety.stop()
        safety.advance(None)
        points.append(safety.set_point)
    assert safety.mode is Mode.IDLE
    np.testing.assert_allclose(points[149], served.action_initial)
    np.testing.assert_allclose(points[-1][3:], [-1.0, served.action_low[4]])
    inner = np.concatenate([np.log(np.asarray(points)[:, :3]), np.asarray(points)[:, 3:]], axis=1)
    most = np.asarray(served.action_rate_per_s) * served.policy_period_s
    assert np.all(np.abs(np.diff(inner, axis=0)) <= most * (1 + 1e-9))


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ({"force_n": (0.0, 300.0, 0.0)}, Cause.FORCE),
        ({"path_error_m": (0.1, 0.1, 0.1)}, Cause.DEVIATION),
        ({"flags": 0}, Cause.ROBOT),
    ],
)
def test_what_is_measured_stops_and_ends_in_fault(
    safety: Safety, change: dict[str, object], cause: Cause
) -> None:
    running(safety)
    for _ in range(3):
        safety.sample(READY._replace(**change))
    assert (safety.mode, safety.cause) == (Mode.SAFE_STOP, cause)
    settle(safety)
    assert (safety.mode, safety.cause) == (Mode.FAULT, cause)


def test_one_spike_of_force_does_not_stop(safety: Safety) -> None:
    running(safety)
    for force in (300.0, 300.0, 1.0, 300.0):
        safety.sample(READY._replace(force_n=(force, 0.0, 0.0)))
    assert safety.mode is Mode.RUNNING


def test_a_fault_of_the_robot_is_a_fault_at_once(safety: Safety) -> None:
    running(safety)
    safety.sample(READY._replace(flags=Robot.READY | Robot.FAULT))
    assert (safety.mode, safety.cause) == (Mode.FAULT, Cause.ROBOT)
    safety.arm(0.0)
    assert safety.mode is Mode.FAULT  # while the robot's own stands


def test_silence_holds_then_stops(safety: Safety) -> None:
    running(safety)
    held = safety.set_point
    assert safety.watch(0.019)
    assert not safety.watch(0.099) and safety.mode is Mode.RUNNING
    safety.advance(None)
    np.testing.assert_array_equal(safety.set_point, held)
    assert not safety.watch(0.101)
    assert (safety.mode, safety.cause) == (Mode.SAFE_STOP, Cause.STALE)


def test_a_late_server_stops(safety: Safety) -> None:
    running(safety)
    safety.watch(0.0, late_s=0.2)
    assert (safety.mode, safety.cause) == (Mode.SAFE_STOP, Cause.OVERRUN)


@pytest.mark.parametrize(
    ("index", "value", "cause"),
    [
        (0, np.nan, Cause.POLICY),
        (4, np.inf, Cause.POLICY),
        (0, -5.0, Cause.POLICY),
        (3, 1.5, Cause.RANGE),
        (4, 0.0019, Cause.RANGE),  # inside its range, but faster than its rate
        (1, 2900.0, Cause.RANGE),
    ],
)
def test_a_policy_that_breaks_its_limits_is_stopped(
    safety: Safety, served: Artefact, index: int, value: float, cause: Cause
) -> None:
    running(safety)
    before = safety.set_point
    wish = before.copy()
    wish[index] = value
    safety.advance(wish)
    assert (safety.mode, safety.cause) == (Mode.SAFE_STOP, cause)
    assert np.all(np.isfinite(safety.set_point)) and np.all(safety.set_point[3:] <= before[3:])


def test_a_worse_cause_during_the_ramp_ends_in_fault(safety: Safety) -> None:
    running(safety)
    safety.stop()
    safety.advance(None)
    safety.watch(1.0)
    safety.stop(Cause.REQUESTED)
    settle(safety)
    assert (safety.mode, safety.cause) == (Mode.FAULT, Cause.STALE)


def test_arming_needs_a_ready_unloaded_robot_that_is_heard(safety: Safety) -> None:
    safety.arm(0.0)
    assert safety.mode is Mode.IDLE  # nothing was measured yet
    safety.sample(READY)
    safety.arm(1.0)
    assert safety.mode is Mode.IDLE
    safety.sample(READY._replace(force_n=(300.0, 0.0, 0.0)))
    safety.arm(0.0)
    assert safety.mode is Mode.IDLE
    safety.sample(READY)
    safety.arm(0.0)
    assert safety.mode is Mode.ARMED


def test_no_walk_leads_from_fault_to_running_but_through_arming(served: Artefact) -> None:
    """Every transition of 20,000 random events lies on the table; RUNNING is entered from ARMED alone."""
    told: list[str] = []
    safety = Safety(served, Limits(), told.append)
    draw = random.Random(1)
    bad = READY._replace(force_n=(400.0, 0.0, 0.0))
    events = [
        lambda: safety.arm(0.0), safety.start, safety.stop, safety.disarm,
        lambda: safety.sample(READY), lambda: safety.sample(READY), lambda: safety.sample(bad),
        lambda: safety.sample(READY._replace(flags=Robot.FAULT)), lambda: safety.watch(0.0),
        lambda: safety.watch(0.5), lambda: safety.stop(Cause.SHUTDOWN), lambda: settle(safety, 5),
        lambda: safety.advance(np.full(5, np.nan)), lambda: settle(safety, 40), lambda: settle(safety, 120),
    ]  # fmt: skip
    modes, by_arm = [safety.mode], set()
    for _ in range(20_000):
        event = draw.randrange(len(events))
        events[event]()
        if safety.mode is not modes[-1]:
            modes.append(safety.mode)
            if safety.mode is Mode.ARMED:
                by_arm.add(event)
    walked = set(itertools.pairwise(modes))
    assert {before for before, after in walked if after is Mode.RUNNING} == {Mode.ARMED}
    assert by_arm == {0}
    assert (Mode.FAULT, Mode.ARMED) in walked and (Mode.FAULT, Mode.IDLE) in walked
    assert sum("->" in line for line in told) >= len(modes) - 1


def test_numbers_beyond_a_measurement_are_not_plausible() -> None:
    assert plausible(READY)
    for name, value in READY._asdict().items():
        wrong = (0.0, -1e9, 0.0) if isinstance(value, tuple) else 1e13
        if name == "command_sequence":
            continue
        assert not plausible(READY._replace(**{name: int(wrong) if name == "flags" else wrong})), name


@pytest.mark.parametrize(
    "change", [{"force_n": 0.0}, {"hold_s": 2.0}, {"fresh_s": 0.2}, {"deviation_m": float("nan")}]
)
def test_limits_out_of_range_are_said(change: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="expected"):
        dataclasses.replace(Limits(), **change)
