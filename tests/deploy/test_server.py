"""The server's logic: what is acted on, what is counted instead, and what a COMMAND says."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from mjx_cutting.deploy import protocol
from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.protocol import Cause, Command, Mode, Packet, Robot, State, Type, Welcome
from mjx_cutting.deploy.runtime import PolicyRuntime
from mjx_cutting.deploy.server import Server, Settings

HERE, THERE = ("127.0.0.1", 40000), ("127.0.0.1", 40001)
STILL = (0.0, 0.0, 0.0)
READY = State(Robot.READY, 0, STILL, STILL, (0.5, 0.3, 0.1), (1.0, 2.0, 3.0), 0.0125, 0.0, 0.0, 0.0, 0.0)
MS = 1_000_000


class Bench:
    """A server and a well-behaved controller on one made-up clock."""

    def __init__(self, artefact: Artefact, key: bytes | None = None, **settings: Any):
        self.log: list[str] = []
        self.recorded: list[tuple[Any, ...]] = []
        self.server = Server(
            PolicyRuntime(artefact),
            Settings(key=key, **settings),
            self.log.append,
            lambda *sample: self.recorded.append(sample),
        )
        self.key = key
        self.now = 10**9
        self.session, self.challenge, self.sequence = 77, 0, 0
        self.state = READY

    def packet(self, kind: Type, body: protocol.Body = None, **change: Any) -> bytes:
        self.sequence += 1
        fields = {
            "session": self.session, "sequence": self.sequence, "challenge": self.challenge,
            "time_ns": self.now, "key": self.key, **change,
        }  # fmt: skip
        return protocol.encode(kind, body, **fields)

    def give(self, data: bytes, address: tuple[str, int] = HERE) -> bytes | None:
        return self.server.handle(data, address, self.now)

    def connect(self) -> Welcome:
        answer = self.give(self.packet(Type.HELLO, challenge=0))
        assert answer is not None
        packet = protocol.decode(answer, self.key)
        assert isinstance(packet, Packet) and isinstance(packet.body, Welcome)
        self.challenge = packet.challenge
        return packet.body

    def pass_(self, periods: int = 1, send: bool = True) -> Command | None:
        """Policy periods with ten STATEs each."""
        command = None
        for _ in range(periods):
            for _ in range(10):
                self.now += 2 * MS
                if send:
                    self.give(self.packet(Type.STATE, self.state))
            answer = self.server.tick(self.now)
            if answer is not None:
                packet = protocol.decode(answer, self.key)
                assert isinstance(packet, Packet) and isinstance(packet.body, Command)
                command = packet.body
        return command

    def run(self) -> None:
        self.connect()
        self.pass_()
        self.give(self.packet(Type.ARM))
        self.give(self.packet(Type.START))
        self.pass_(60)
        assert self.server.mode is Mode.RUNNING and self.server.safety.policy_acts

    def total(self) -> dict[str, int]:
        return {name: n for name, n in self.server.counts.items() if n and name != "accepted"}


@pytest.fixture
def bench(served: Artefact) -> Bench:
    return Bench(served)


def test_welcome_says_what_will_be_served(bench: Bench, served: Artefact) -> None:
    welcome = bench.connect()
    assert welcome.policy_sha256.hex() == served.sha256
    assert (welcome.period_us, welcome.hold_us) == (20000, 100000)
    assert welcome.low == served.action_low and welcome.high == served.action_high
    assert bench.server.peer is None  # HELLO changes nothing


def test_the_policy_acts_on_the_mean_of_the_last_ten_samples(bench: Bench, served: Artefact) -> None:
    bench.run()
    runtime = PolicyRuntime(served)
    before = bench.server.safety.set_point
    forces = np.random.default_rng(0).normal(0, 5, (15, 3))
    for force in forces:
        bench.now += MS
        bench.state = READY._replace(
            force_n=tuple(force), path_error_m=(0.001, 0.002, 0.003), velocity_m_s=(0.0, -0.01, 0.001)
        )
        bench.give(bench.packet(Type.STATE, bench.state))
    answer = protocol.decode(bench.server.tick(bench.now) or b"")
    assert isinstance(answer, Packet) and isinstance(answer.body, Command)
    observation = np.array(
        [0.0125, 0.001, 0.002, 0.003, 0.0, -0.01, 0.001, *forces[5:].mean(0), before[3], before[4],
         *np.log(before[:3])]
    )  # fmt: skip
    wanted = runtime.advance(before, runtime(observation))
    np.testing.assert_allclose(answer.body.set_point, wanted, rtol=1e-6, atol=1e-9)
    assert not np.allclose(wanted, before)
    assert answer.body.answers == bench.sequence and answer.body.answers_time_ns == bench.now


def test_a_rehearsal_changes_nothing(served: Artefact) -> None:
    one, other = Bench(served), Bench(served)
    for bench in (one, other):
        bench.server.rehearse()
        bench.run()
        for _ in range(20):
            if bench is other:
                bench.server.rehearse()
            bench.pass_()
    np.testing.assert_array_equal(one.server.safety.set_point, other.server.safety.set_point)


def test_silence_holds_and_then_stops_and_only_arming_leads_back(bench: Bench) -> None:
    bench.run()
    held = bench.pass_(2, send=False)
    assert held is not None and held.mode is Mode.RUNNING
    stopping = bench.pass_(5, send=False)
    assert stopping is not None and (stopping.mode, stopping.cause) == (Mode.SAFE_STOP, Cause.STALE)
    bench.pass_(100)
    assert bench.server.mode is Mode.FAULT
    bench.give(bench.packet(Type.START))
    assert bench.pass_(10).mode is Mode.FAULT  # type: ignore[union-attr]
    bench.give(bench.packet(Type.ARM))
    bench.give(bench.packet(Type.START))
    assert bench.pass_().mode is Mode.RUNNING  # type: ignore[union-attr]


def test_every_other_mode_commands_standstill(bench: Bench) -> None:
    bench.connect()
    command = bench.pass_(5)
    assert command is not None and command.mode is Mode.IDLE
    assert command.set_point[3:] == (-1.0, 0.0)


def hostile(bench: Bench) -> dict[str, list[tuple[bytes, tuple[str, int]]]]:
    """Packets by the reason for which they must be refused, while a cut runs."""
    bad, state = bench.packet, READY
    keyed = {"key": b"wrong key" if bench.key else b"some key"}
    nan = state._replace(force_n=(0.0, float("nan"), 0.0))
    bench.now += MS
    last = bench.packet(Type.STATE, state)
    bench.give(last)
    bench.now += MS
    skipped = bad(Type.STATE, state)
    bench.give(bad(Type.STATE, state._replace(force_n=(0.0, 0.0, 1.0))))
    stop = bytearray(bad(Type.STOP))
    stop[12] ^= 1
    return {
        "size": [(b"", HERE), (last + b"\0", HERE), (last[:-1], HERE)],
        "magic": [(b"x" * 216, HERE)],
        "version": [(last[:4] + b"\2" + last[5:], HERE)],
        "type": [(last[:5] + b"\x63" + last[6:], HERE)],
        "crc": [(bytes(stop), HERE)],
        "key": [(bad(Type.STOP, **keyed), HERE)],
        "field": [(bad(Type.STOP, session=0), HERE)],
        "value": [(bad(Type.STATE, nan), HERE)],
        "direction": [(bad(Type.WELCOME, Welcome(bytes(32), 1, 1, 1.0, *((1.0,) * 5,) * 4)), HERE)],
        "unknown_peer": [(bad(Type.STOP), THERE), (bad(Type.HELLO, challenge=0, session=5), THERE)],
        "wrong_session": [
            (bad(Type.STOP, session=78), HERE),
            (bad(Type.STOP, challenge=bench.challenge ^ 1), HERE),
            (bad(Type.HELLO, challenge=0), HERE),
        ],
        "duplicate": [(last, HERE)],
        "reordered": [(skipped, HERE)],
        "replayed": [(bad(Type.STOP, sequence=1), HERE)],
        "time": [(bad(Type.STATE, state, time_ns=bench.now - 5 * MS), HERE)],
        "range": [(bad(Type.STATE, state._replace(force_n=(1e6, 0.0, 0.0))), HERE)],
    }


@pytest.mark.parametrize("key", [None, b"0123456789abcdef"], ids=["unsigned", "signed"])
def test_what_is_refused_is_counted_and_changes_nothing(served: Artefact, key: bytes | None) -> None:
    bench = Bench(served, key)
    bench.run()
    packets = hostile(bench)
    server = bench.server
    before = (server.mode, server._state, list(server._forces), server.counts["accepted"], server.peer.last)  # type: ignore[union-attr]
    for reason, given in packets.items():
        counted = server.counts[reason]
        for data, address in given:
            assert bench.give(data, address) is None
        assert server.counts[reason] == counted + len(given), reason
    after = (server.mode, server._state, list(server._forces), server.counts["accepted"], server.peer.last)  # type: ignore[union-attr]
    assert after == before
    assert set(packets) == set(bench.total())
    bench.pass_()
    assert server.mode is Mode.RUNNING


def test_a_recorded_conversation_cannot_be_replayed(served: Artefact) -> None:
    """Neither to a server started anew nor, once the peer is gone, to the same from the same address."""
    bench = Bench(served, b"0123456789abcdef")
    sent: list[bytes] = []
    give = bench.give
    bench.give = lambda data, address=HERE: (sent.append(data), give(data, address))[1]  # type: ignore[method-assign]
    bench.run()
    bench.give(bench.packet(Type.STOP))
    bench.pass_(100)
    assert bench.server.mode is Mode.IDLE
    other = Bench(served, b"0123456789abcdef")
    bench.now += 10**10
    for server in (bench.server, other.server):
        for at, data in enumerate(sent):
            server.handle(data, HERE, bench.now + at * 2 * MS)
            if at % 10 == 0:
                server.tick(bench.now + at * 2 * MS)
            assert server.mode is Mode.IDLE


def test_another_controller_waits_until_the_first_was_silent(bench: Bench) -> None:
    bench.connect()
    bench.pass_(3)
    second = bench.packet(Type.HELLO, challenge=0, session=99)
    assert bench.give(second, THERE) is None and bench.server.counts["unknown_peer"] == 1
    bench.now += 1_100 * MS
    answer = bench.give(second, THERE)
    assert answer is not None
    welcome = protocol.decode(answer)
    assert isinstance(welcome, Packet)
    state = protocol.encode(Type.STATE, READY, session=99, sequence=5, challenge=welcome.challenge, time_ns=5)
    bench.give(state, THERE)
    assert bench.server.peer is not None and bench.server.peer.address == THERE


def test_a_running_cut_is_not_taken_over_even_after_silence(bench: Bench) -> None:
    bench.run()
    bench.now += 1_500 * MS
    assert bench.give(bench.packet(Type.HELLO, challenge=0, session=99), THERE) is None


def test_a_peer_that_comes_back_after_a_fault_must_arm(bench: Bench) -> None:
    bench.run()
    bench.pass_(100, send=False)
    assert bench.server.mode is Mode.FAULT
    bench.session, bench.sequence = 1234, 0
    bench.connect()
    bench.give(bench.packet(Type.START))
    assert bench.pass_(5).mode is Mode.FAULT  # type: ignore[union-attr]


def test_swapping_the_policy(bench: Bench, make_served: Callable[..., Artefact]) -> None:
    other = PolicyRuntime(make_served(seed=5))
    bench.run()
    assert not bench.server.swap(other) and bench.server.runtime is not other
    bench.give(bench.packet(Type.STOP))
    bench.pass_(100)
    assert bench.server.swap(other) and bench.server.runtime is other
    assert bench.pass_() is None  # released: it was welcomed with other limits
    assert bench.connect().policy_sha256.hex() == other.artefact.sha256


def test_a_policy_of_another_task_is_refused(policy_of_another_task: Artefact, bench: Bench) -> None:
    with pytest.raises(ValueError, match="observes o0"):
        Bench(policy_of_another_task)
    with pytest.raises(ValueError, match="observes o0"):
        bench.server.swap(PolicyRuntime(policy_of_another_task))
    assert bench.connect().policy_sha256.hex() == bench.server.runtime.artefact.sha256


@pytest.fixture
def policy_of_another_task(served: Artefact) -> Artefact:
    import dataclasses

    return dataclasses.replace(served, observation_names=tuple(f"o{i}" for i in range(15)))


def test_only_running_samples_are_recorded(bench: Bench) -> None:
    bench.run()
    assert len(bench.recorded) == 600
    time_ns, state, set_point, trial = bench.recorded[-1]
    assert time_ns == bench.now and state == READY and trial == 1
    assert set_point[3] > -1.0
    bench.give(bench.packet(Type.STOP))
    bench.pass_(60)
    assert len(bench.recorded) == 600


def test_ten_percent_loss_and_reordering_do_not_stop_a_cut(bench: Bench) -> None:
    bench.run()
    draw = random.Random(3)
    for _ in range(200):
        packets = []
        for _ in range(10):
            bench.now += 2 * MS
            packets.append(bench.packet(Type.STATE, READY))
        packets = [p for p in packets if draw.random() > 0.1]
        for at in range(len(packets) - 1):
            if draw.random() < 0.2:
                packets[at], packets[at + 1] = packets[at + 1], packets[at]
        for packet in packets:
            bench.give(packet)
        bench.server.tick(bench.now)
    assert bench.server.mode is Mode.RUNNING
    assert set(bench.total()) == {"reordered"}


def test_the_server_is_light() -> None:
    code = (
        "import time; t = time.process_time()\n"
        "import mjx_cutting.deploy.service, mjx_cutting.deploy.client, mjx_cutting.deploy.realtime\n"
        "import json, pathlib\n"
        "lines = pathlib.Path('/proc/self/status').read_text().splitlines()\n"
        "status = dict(line.split(':', 1) for line in lines)\n"
        "print(json.dumps([time.process_time() - t, int(status['VmHWM'].split()[0]) / 1024]))"
    )
    runs = []
    for _ in range(3):
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        runs.append(json.loads(done.stdout))
    assert min(seconds for seconds, _ in runs) < 0.5
    assert runs[0][1] < 100.0  # MB


def test_no_memory_grows_without_a_garbage_collector(served: Artefact) -> None:
    """The serving loop runs with it switched off, so nothing there may be kept alive by a cycle."""
    import gc
    import tracemalloc

    bench = Bench(served, b"0123456789abcdef")
    bench.server._record = None
    bench.run()
    bench.pass_(50)
    gc.collect()
    gc.disable()
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        bench.pass_(300)
        for data in (b"x" * 100, bench.packet(Type.STATE, READY, time_ns=1)):
            for _ in range(1000):
                bench.give(data)
        unreachable = gc.collect()  # and Python's own free lists are emptied
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
        gc.enable()
    assert bench.server.mode is Mode.RUNNING
    assert unreachable == 0 and grown < 8192
