"""The serving loop: one thread, one UDP socket, a COMMAND at every period, and nothing that can block it.

Each period: packets are taken as they come until the COMMAND is due; it is made and sent; then, with the rest
of the period to spare, the log, the recorder and a request for statistics get their turn. All times are
monotonic; a step of the wall clock is not seen here. A flood of packets delays a COMMAND by one packet's
handling, for the clock is looked at after each.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socket
import sys
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

from mjx_cutting._files import explain
from mjx_cutting.deploy.protocol import SIZE_AT_MOST, Cause, Mode
from mjx_cutting.deploy.recorder import Recorder
from mjx_cutting.deploy.runtime import TOLERANCE, PolicyRuntime
from mjx_cutting.deploy.server import Server
from mjx_cutting.deploy.stats import StatsPort, prometheus

# isort: split
import numpy as np

LINES_KEPT = 1000
_WATCH_S = 1.0
_REHEARSAL_NS = 1_000_000
"""How long before a COMMAND is due the policy is run for nothing: it takes a third off the latency."""


def bind(host: str, port: int) -> socket.socket:
    """Returns a UDP socket bound there.

    Raises:
        OSError: the port is taken or the address is not this machine's.
    """
    udp = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
    try:
        udp.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2**20)
        udp.bind((host, port))
    except OSError as error:
        udp.close()
        raise OSError(error.errno, error.strerror, f"{host}:{port}") from error
    udp.setblocking(False)
    return udp


class Log:
    """Lines with the seconds since the start, written to a file descriptor only when that cannot block."""

    def __init__(self, descriptor: int = 2):
        self._descriptor, self._start_s = descriptor, time.monotonic()
        self._lines: deque[str] = deque(maxlen=LINES_KEPT)

    def __call__(self, line: str) -> None:
        """Keeps a line for `flush`; the oldest of a thousand is dropped."""
        self._lines.append(f"{time.monotonic() - self._start_s:10.3f} s  {line}\n")

    def flush(self) -> None:
        """Writes what is kept, as far as the descriptor takes it at once."""
        while self._lines and select.select([], [self._descriptor], [], 0)[1]:
            with contextlib.suppress(OSError):  # nobody reads; the line is lost, serving goes on
                os.write(self._descriptor, self._lines[0].encode()[: select.PIPE_BUF])
            self._lines.popleft()


class Service:
    """A server on its socket.

    Arguments:
        server: the logic; udp: its socket; log.
        policy: file to load again on SIGHUP, and where `watch`, when it changes while IDLE.
        stats, recorder: where wanted.
    """

    def __init__(
        self,
        server: Server,
        udp: socket.socket,
        log: Log,
        *,
        policy: Path | None = None,
        watch: bool = False,
        stats: StatsPort | None = None,
        recorder: Recorder | None = None,
    ):
        self.server, self._udp, self._log = server, udp, log
        self._policy, self._watch, self._stats, self._recorder = policy, watch, stats, recorder
        self._stops = 0
        self._reload = False
        self._stamp = _stamp(policy)
        self._looked_ns = 0

    def install_signals(self) -> None:
        """SIGTERM and SIGINT: ramp to standstill, then end (a second one: at once). SIGHUP: load again."""

        def stop(number: int, frame: object) -> None:
            self._stops += 1

        def reload(number: int, frame: object) -> None:
            self._reload = True

        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, stop)
        signal.signal(signal.SIGHUP, reload)

    def run(self, until: Callable[[], bool] | None = None) -> None:
        """Serves until a signal, or until `until` is true; then the robot stands still."""
        due_ns = time.monotonic_ns()
        while True:
            period_ns = round(self.server.runtime.artefact.policy_period_s * 1e9)
            due_ns += period_ns
            late = time.monotonic_ns() - due_ns
            if late > 0:  # skip what was missed, keep the phase
                due_ns += late // period_ns * period_ns
            if period_ns > 4 * _REHEARSAL_NS:
                self._receive(due_ns - _REHEARSAL_NS)
                self.server.rehearse()
            self._receive(due_ns)
            self._send(due_ns)
            if self._between(until):
                break
        self._log.flush()

    def _receive(self, due_ns: int) -> None:
        server, udp = self.server, self._udp
        while (left_ns := due_ns - time.monotonic_ns()) > 0:
            if not select.select([udp], [], [], left_ns * 1e-9)[0]:
                continue
            try:
                data, address = udp.recvfrom(SIZE_AT_MOST + 1)
            except (BlockingIOError, ConnectionError):
                continue
            answer = server.handle(data, address[:2], time.monotonic_ns())
            if answer is not None:
                self._to(address, answer)

    def _send(self, due_ns: int) -> None:
        server = self.server
        now_ns = time.monotonic_ns()
        command = server.tick(now_ns, (now_ns - due_ns) * 1e-9)
        if command is not None and server.peer is not None:
            self._to(server.peer.address, command)
            server.latency.add((time.monotonic_ns() - due_ns) * 1e-9)

    def _to(self, address: tuple, data: bytes) -> None:
        with contextlib.suppress(OSError):  # a full buffer, a peer that went: as good as lost on the way
            self._udp.sendto(data, address)

    def _between(self, until: Callable[[], bool] | None) -> bool:
        server = self.server
        if self._recorder is not None:
            self._recorder.flush(running=server.mode is Mode.RUNNING)
            if (line := self._recorder.news()) is not None:
                self._log(line)
        if self._stats is not None:
            self._stats.poll(self._text)
        if self._reload or (self._watch and self._changed()):
            self._reload = False
            self._load()
        self._log.flush()
        if not self._stops and until is not None and until():
            self._stops = 1
        if self._stops == 1 and server.mode in (Mode.ARMED, Mode.RUNNING):
            server.safety.stop(Cause.SHUTDOWN)
        return self._stops > 1 or (self._stops == 1 and not server.moving)

    def _text(self) -> str:
        recorder = self._recorder
        return prometheus(self.server, recorder.taken, recorder.lost) if recorder else prometheus(self.server)

    def _changed(self) -> bool:
        now_ns = time.monotonic_ns()
        if self.server.mode is not Mode.IDLE or now_ns - self._looked_ns < _WATCH_S * 1e9:
            return False
        self._looked_ns = now_ns
        stamp, self._stamp = self._stamp, _stamp(self._policy)
        return self._stamp is not None and stamp != self._stamp

    def _load(self) -> None:
        if self._policy is None:
            return
        if self.server.mode is not Mode.IDLE:
            self.server.swaps_refused += 1
            self._log(f"new policy refused in {self.server.mode.name}: stop and disarm first")
            return
        try:
            self.server.swap(load(self._policy))
        except (ValueError, OSError) as error:
            self.server.swaps_refused += 1
            told = explain(error) if isinstance(error, OSError) else error
            self._log(f"new policy refused, the present one stays: {told}")


def load(path: Path) -> PolicyRuntime:
    """Returns the runtime of a policy whose golden pairs this machine reproduces.

    Raises:
        ValueError: it does not, or the file is no policy.
    """
    runtime = PolicyRuntime.load(path)
    artefact = runtime.artefact
    actions = np.stack([runtime(observation) for observation in artefact.golden_observation])
    worst = float(np.max(np.abs(actions - artefact.golden_action))) / 2.0
    if not worst <= TOLERANCE:
        raise ValueError(
            f"got {path}, whose golden pairs this machine misses by {worst:.1e} of an action's range; "
            f"expected at most {TOLERANCE:g}; export it again"
        )
    return runtime


def say(line: str) -> None:
    """Writes a line before the loop starts."""
    print(line, file=sys.stderr, flush=True)


def _stamp(path: Path | None) -> tuple[int, int, int] | None:
    try:
        status = os.stat(path) if path is not None else None
    except OSError:
        return None
    return (status.st_mtime_ns, status.st_size, status.st_ino) if status is not None else None
