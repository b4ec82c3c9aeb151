"""Faults on loopback: a bad network, peers and servers that die, a second client, a step of the clock."""

from __future__ import annotations

import ast
import contextlib
import heapq
import random
import select
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import mjx_cutting.deploy
from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.client import Client
from mjx_cutting.deploy.protocol import Cause, Mode, Robot, State, Type
from mjx_cutting.deploy.runtime import PolicyRuntime
from mjx_cutting.deploy.safety import Limits
from mjx_cutting.deploy.server import Server, Settings
from mjx_cutting.deploy.service import Log, Service, bind

KEY = b"0123456789abcdef"
STILL = (0.0, 0.0, 0.0)
READY = State(Robot.READY, 0, STILL, STILL, (0.5, 0.3, 0.1), (1.0, 2.0, 3.0), 0.0125, 0.0, 0.0, 0.0, 0.0)
PATIENT = Limits(hold_s=1.0, overrun_s=1.0)
"""On a busy machine the test itself may be late; what is tested is not the machine."""


class Running:
    """A service in a thread."""

    def __init__(self, artefact: Artefact, port: int = 0, limits: Limits = PATIENT):
        self.udp = bind("127.0.0.1", port)
        self.port: int = self.udp.getsockname()[1]
        self.server = Server(PolicyRuntime(artefact), Settings(limits, KEY), lambda line: None)
        self._end = threading.Event()
        self.service = Service(self.server, self.udp, Log())
        self._thread = threading.Thread(target=self.service.run, args=(self._end.is_set,))
        self._thread.start()

    def close(self) -> None:
        self._end.set()
        self._thread.join()
        self.udp.close()


@pytest.fixture
def serving(served: Artefact) -> Iterator[Running]:
    running = Running(served)
    yield running
    running.close()


class Wire:
    """A UDP proxy that loses, overtakes and delays."""

    def __init__(self, port: int, loss: float = 0.0, reordering: float = 0.0, burst_s: float = 0.0):
        self._to, self._draw = ("127.0.0.1", port), random.Random(0)
        self._loss, self._reordering, self._burst_s = loss, reordering, burst_s
        self._in, self._out = bind("127.0.0.1", 0), bind("127.0.0.1", 0)
        self.port: int = self._in.getsockname()[1]
        self.lost = self.overtaken = self.delayed = 0
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        waiting: list[tuple[float, int, socket.socket, bytes, tuple[str, int]]] = []
        client, count, start = None, 0, time.monotonic()
        while not self._end.is_set():
            readable = select.select([self._in, self._out], [], [], 0.001)[0]
            now = time.monotonic()
            stuck = (now - start) % 0.5 < self._burst_s
            for udp in readable:
                data, address = udp.recvfrom(400)
                client = address if udp is self._in else client
                if self._draw.random() < self._loss:
                    self.lost += 1
                    continue
                due = now
                if self._draw.random() < self._reordering:
                    due += 0.005
                    self.overtaken += 1
                if stuck:
                    due += self._burst_s - (now - start) % 0.5
                    self.delayed += 1
                count += 1
                out, to = (self._out, self._to) if udp is self._in else (self._in, client)
                assert to is not None
                heapq.heappush(waiting, (due, count, out, data, to))
            while waiting and waiting[0][0] <= now:
                _, _, out, data, to = heapq.heappop(waiting)
                out.sendto(data, to)

    def close(self) -> None:
        self._end.set()
        self._thread.join()
        self._in.close()
        self._out.close()


def drive(
    client: Client, seconds: float, until: Callable[[Client], bool] | None = None, start: bool = True
) -> list[tuple[float, Mode, float]]:
    """STATE at 500 Hz, arming and starting; time, mode, feed adjustment at each cycle of the robot."""
    begin, seen = time.monotonic(), []
    cycle = 0
    while (now := time.monotonic() - begin) < seconds:
        client.send_state(READY)
        command = client.poll()
        if command is not None and start and client.follower is not None and not client.follower.silent:
            if command.mode in (Mode.IDLE, Mode.FAULT):
                client.ask(Type.ARM)
            elif command.mode is Mode.ARMED:
                client.ask(Type.START)
        if client.follower is not None:
            seen.append((now, client.follower.mode, float(client.follower.at(time.monotonic_ns())[3])))
        if until is not None and until(client):
            return seen
        cycle += 1
        time.sleep(max(0.0, begin + cycle * 0.002 - time.monotonic()))
    return seen


def mode_is(mode: Mode) -> Callable[[Client], bool]:
    return lambda client: client.command is not None and client.command.mode is mode


@contextlib.contextmanager
def connected(port: int) -> Iterator[Client]:
    client = Client("127.0.0.1", port, KEY)
    client.connect(5.0)
    yield client
    client.close()


def test_a_cut_goes_on_through_loss_reordering_and_bursts(serving: Running) -> None:
    wire = Wire(serving.port, loss=0.1, reordering=0.2, burst_s=0.05)
    try:
        with connected(wire.port) as client:
            drive(client, 5.0, mode_is(Mode.RUNNING))
            seen = drive(client, 2.5, start=False)
    finally:
        wire.close()
    assert wire.lost > 50 and wire.overtaken > 100 and wire.delayed > 20
    assert {mode for _, mode, _ in seen} == {Mode.RUNNING}
    assert serving.server.counts["reordered"] > 20
    assert serving.server.counts["duplicate"] == serving.server.counts["replayed"] == 0
    feeds = np.array([feed for _, _, feed in seen])
    assert feeds[-1] > -1.0 and np.all(np.abs(np.diff(feeds)) < 2.0 * 0.1)


def test_a_restarted_controller_finds_a_fault_and_must_arm(serving: Running) -> None:
    with connected(serving.port) as client:
        drive(client, 5.0, mode_is(Mode.RUNNING))
    with connected(serving.port) as again:  # it died without a word
        seen = drive(again, 0.3, start=False)
        assert again.command is not None
        assert (again.command.mode, again.command.cause) == (Mode.FAULT, Cause.STALE)
        assert all(feed == -1.0 for _, _, feed in seen)
        drive(again, 5.0, mode_is(Mode.RUNNING))
        assert again.command.mode is Mode.RUNNING


def test_a_server_that_dies_leaves_a_robot_that_stops(served: Artefact) -> None:
    """Closing its socket and its thread without a word is what kill -9 looks like from outside."""
    first = Running(served)
    with connected(first.port) as client:
        drive(client, 5.0, mode_is(Mode.RUNNING))
        drive(client, 1.0, start=False)
        first.service._to = lambda address, data: None  # type: ignore[method-assign]
        seen = drive(client, 2.5, start=False)
        first.close()
        assert client.follower is not None and client.follower.silent and client.follower.standing
        feeds = np.array([feed for _, _, feed in seen])
        assert feeds[0] > -1.0 and feeds[-1] == -1.0
        assert np.all(np.diff(feeds[len(feeds) // 2 :]) <= 0)
        second = Running(served, first.port)
        try:
            seen = drive(client, 0.5, start=False)  # the old session is worth nothing there
            assert all(feed == -1.0 for _, _, feed in seen) and second.server.mode is Mode.IDLE
            assert second.server.counts["wrong_session"] > 100
            with connected(second.port) as again:
                drive(again, 5.0, mode_is(Mode.RUNNING))
                assert again.command is not None and again.command.mode is Mode.RUNNING
        finally:
            second.close()


def test_a_second_client_is_turned_away(serving: Running) -> None:
    with connected(serving.port) as client:
        drive(client, 5.0, mode_is(Mode.RUNNING))
        second = Client("127.0.0.1", serving.port, KEY)
        told: list[type] = []

        def try_it() -> None:
            try:
                second.connect(0.5)
            except TimeoutError as error:
                told.append(type(error))

        thread = threading.Thread(target=try_it)
        thread.start()
        counts = serving.server.counts
        seen = drive(client, 10.0, lambda _: bool(told) and counts["unknown_peer"] >= second.sequence, False)
        thread.join()
        second.close()
        assert told == [TimeoutError] and counts["unknown_peer"] == second.sequence > 0  # every HELLO of it
        assert {mode for _, mode, _ in seen} == {Mode.RUNNING}


def test_a_step_of_the_wall_clock_is_not_seen(serving: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    with connected(serving.port) as client:
        drive(client, 5.0, mode_is(Mode.RUNNING))
        steps = iter(range(10**9))
        monkeypatch.setattr(time, "time", lambda: -1e9 * next(steps))
        monkeypatch.setattr(time, "time_ns", lambda: -(10**18) * next(steps))
        assert {mode for _, mode, _ in drive(client, 0.5, start=False)} == {Mode.RUNNING}


def test_no_file_of_the_serving_side_reads_the_wall_clock() -> None:
    folder = Path(mjx_cutting.deploy.__file__).parent
    wall = {"time", "time_ns", "localtime", "gmtime", "ctime", "clock_gettime"}
    found = []
    for path in (*folder.glob("*.py"), folder.parent / "trials" / "parts.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import | ast.ImportFrom) and "datetime" in ast.unparse(node):
                found.append(f"{path.name}:{node.lineno} datetime")
            if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "time" and node.attr in wall:
                found.append(f"{path.name}:{node.lineno} {node.attr}")
    assert not found


def test_garbage_on_the_socket_delays_nothing(serving: Running) -> None:
    with connected(serving.port) as client, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        drive(client, 5.0, mode_is(Mode.RUNNING))
        draw = random.Random(0)
        for _ in range(200):
            for _ in range(5):
                udp.sendto(b"MJXC" + draw.randbytes(draw.randrange(300)), ("127.0.0.1", serving.port))
            drive(client, 0.005, start=False)
        assert client.command is not None and client.command.mode is Mode.RUNNING
        counts = serving.server.counts
        assert sum(counts[name] for name in ("size", "version", "type", "crc")) > 900
