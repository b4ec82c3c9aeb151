"""The cell as a process of its own: a UDP socket, and a clock that ticks a thousand times a second.

The cell keeps its own time, one millisecond a tick, which is what its packets carry. Each tick waits for its
moment; where the machine is too slow for real time, the cell falls behind and says by how much, instead of
skipping physics. (Faster than real time is `deploy.export_check.Lockstep`: without sockets, on one clock.)
"""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from mjx_cutting.deploy.protocol import SIZE_AT_MOST
from mjx_cutting.deploy.virtual_cell.cell import TICK_NS, Cell

CATCH_UP_S = 0.1
"""A process that is later than this lets the lost time go, or the server would hear a burst."""


@dataclass(frozen=True)
class Outcome:
    """What became of a trial. Fields: `score` plain numbers; `phase` the controller ended in; `counts` of
    packets; `simulated_s`, `wall_s`; `busy` share of the time spent computing; `latest_s` largest delay of a
    tick."""

    score: dict[str, Any]
    phase: str
    counts: dict[str, int]
    simulated_s: float
    wall_s: float
    busy: float
    latest_s: float

    def line(self) -> str:
        """One line of JSON."""
        return json.dumps(asdict(self))


class Process:
    """A cell at a socket. Arguments: cell; `server` host and port.

    Raises:
        OSError: the server's address cannot be resolved.
    """

    def __init__(self, cell: Cell, server: tuple[str, int]):
        self.cell = cell
        family, _, _, _, address = socket.getaddrinfo(*server, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.connect(address)
        self._now_ns = 0

    def close(self) -> None:
        """Lets go of the socket."""
        self._socket.close()

    def run(self, *, longest_s: float = 120.0, stopped: Callable[[], bool] = lambda: False) -> Outcome:
        """One trial, until the tool is clear of the sheet, `longest_s` have passed, or `stopped` says so."""
        cell, first, begun = self.cell, self._now_ns, time.monotonic()
        start, latest, slept = begun, 0.0, 0.0
        while not cell.done and self._now_ns - first < longest_s * 1e9 and not stopped():
            self._now_ns += TICK_NS
            left = start + 1e-9 * (self._now_ns - first) - time.monotonic()
            if left > 0.0:
                time.sleep(left)
                slept += left
            latest = max(latest, -left)
            if left < -CATCH_UP_S:
                start -= left
            self._receive()
            for data in cell.tick(self._now_ns):
                self._send(data)
        wall = max(time.monotonic() - begun, 1e-9)
        return Outcome(
            cell.score.to_dict(), cell.follower.phase.value, dict(cell.endpoint.counts),
            1e-9 * (self._now_ns - first), wall, 1.0 - slept / wall, latest,
        )  # fmt: skip

    def _receive(self) -> None:
        while True:
            try:
                data = self._socket.recv(SIZE_AT_MOST + 1)
            except (BlockingIOError, ConnectionRefusedError):  # nothing there; nobody there
                return
            self.cell.receive(data, self._now_ns)

    def _send(self, data: bytes) -> None:
        try:
            self._socket.send(data)
        except (BlockingIOError, ConnectionRefusedError):
            self.cell.endpoint.counts["unsent"] += 1


def address(text: str) -> tuple[str, int]:
    """Host and port of "HOST:PORT".

    Raises:
        ValueError: it is not of that form.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise ValueError(f"got the server {text!r}; expected HOST:PORT, such as 127.0.0.1:50500")
    return host.strip("[]"), int(port)
