"""The controller's side of the conversation, for tests and as an example for those who write their own.

`Follower` is what a controller must do with COMMANDs, without any socket: interpolate to the set-points over
the policy's period at its own rate, and when no COMMAND has come for `hold_us`, or the server has left
RUNNING, ramp to standstill. Silence is latched: a server that comes back must first show another mode than
RUNNING, so a cut never goes on by itself. `Client` puts it on a socket.
"""

from __future__ import annotations

import secrets
import socket
import time
from collections.abc import Callable

from mjx_cutting.deploy import protocol
from mjx_cutting.deploy.protocol import Command, Mode, Packet, State, Type, Welcome

# isort: split
import numpy as np

_AGAIN_S = 0.1
"""Between two HELLOs, and between two requests for the same change of mode."""

FEED, DEPTH = 3, 4


class Follower:
    """Set-points at the controller's own rate.

    Arguments:
        welcome: limits and rates of the policy being served.
    """

    def __init__(self, welcome: Welcome):
        self._welcome = welcome
        rate = np.asarray(welcome.rate_per_s, float)
        self._stop_rate = np.where(rate > 0, rate, np.inf)
        self._from = np.asarray(welcome.initial, float)
        self._from[FEED], self._from[DEPTH] = -1.0, welcome.low[DEPTH]
        self._to = self._now = self._from
        self._taken_ns: int | None = None
        self._at_ns: int | None = None
        self.mode = Mode.IDLE
        self.silent = False

    def take(self, command: Command, now_ns: int) -> None:
        """Takes a COMMAND that has just come."""
        if not (self.silent and command.mode is Mode.RUNNING):
            self.silent = False
            self._from, self._to = self._now, np.asarray(command.set_point)
            self._taken_ns = now_ns
        self.mode = command.mode

    def at(self, now_ns: int) -> np.ndarray:
        """Returns [5] the set-points for this cycle of the controller; call it every cycle."""
        since_s = 0.0 if self._at_ns is None else (now_ns - self._at_ns) * 1e-9
        self._at_ns = now_ns
        if self._taken_ns is not None and now_ns - self._taken_ns > self._welcome.hold_us * 1000:
            self.silent = True
        if self.silent:
            step = self._stop_rate[[FEED, DEPTH]] * since_s
            target = np.array([-1.0, self._welcome.low[DEPTH]])
            now = self._now.copy()
            now[[FEED, DEPTH]] += np.clip(target - now[[FEED, DEPTH]], -step, step)
            self._now = now
        elif self._taken_ns is not None:
            share = min(1.0, (now_ns - self._taken_ns) / (self._welcome.period_us * 1000))
            self._now = self._from + share * (self._to - self._from)
        return self._now.copy()

    @property
    def standing(self) -> bool:
        """Whether the set-points are those of standstill."""
        return bool(self._now[FEED] <= -1.0 + 1e-9)


class Client:
    """One controller on a UDP socket, connected to one server.

    Arguments:
        host, port: of the server.
        key: the shared key, where the server has one.
        clock_ns: monotonic clock.
    """

    def __init__(
        self,
        host: str,
        port: int,
        key: bytes | None = None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ):
        self._key, self._clock_ns = key, clock_ns
        self._udp = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.connect((host, port))
        self._udp.setblocking(False)
        self.session = secrets.randbelow(2**32 - 1) + 1
        self.challenge = 0
        self.sequence = 0
        self.welcome: Welcome | None = None
        self.follower: Follower | None = None
        self.command: Command | None = None
        self.rejected = 0
        self.round_trip_s: float | None = None
        self._last = 0
        self._asked_ns: dict[Type, int] = {}

    def close(self) -> None:
        """Closes the socket."""
        self._udp.close()

    def connect(self, timeout_s: float = 2.0) -> Welcome:
        """Says HELLO until WELCOME comes.

        Raises:
            TimeoutError: none came.
        """
        end_ns = self._clock_ns() + round(timeout_s * 1e9)
        while self.welcome is None and self._clock_ns() < end_ns:
            self.ask(Type.HELLO)
            time.sleep(0.002)
            self.poll()
        if self.welcome is None:
            raise TimeoutError(
                f"got no WELCOME within {timeout_s:g} s; check address, key, and other clients"
            )
        return self.welcome

    def send_state(self, state: State, time_ns: int | None = None) -> None:
        """Sends one sample, stamped with its time; the newest COMMAND's number is filled in."""
        self._send(Type.STATE, state._replace(command_sequence=self._last), time_ns)

    def ask(self, kind: Type) -> None:
        """Sends HELLO, ARM, START, STOP or DISARM; at most ten times a second, however often called."""
        now_ns = self._clock_ns()
        if now_ns - self._asked_ns.get(kind, -(10**18)) >= _AGAIN_S * 1e9:
            self._asked_ns[kind] = now_ns
            self._send(kind, None, now_ns)

    def poll(self) -> Command | None:
        """Takes what has come; returns the newest COMMAND of all, None before the first."""
        while True:
            try:
                data = self._udp.recv(protocol.SIZE_AT_MOST + 1)
            except BlockingIOError:
                return self.command
            except ConnectionError:  # nobody listens there (yet)
                continue
            packet = protocol.decode(data, self._key)
            if not isinstance(packet, Packet) or packet.session != self.session:
                self.rejected += 1
            else:
                self._take(packet)

    def _take(self, packet: Packet) -> None:
        now_ns = self._clock_ns()
        if isinstance(packet.body, Welcome):
            if self.challenge == 0 or self._last == 0:  # until the server has taken us, the newest counts
                self.challenge, self.welcome = packet.challenge, packet.body
                self.follower = Follower(packet.body)
        elif isinstance(packet.body, Command) and packet.challenge == self.challenge:
            if packet.sequence <= self._last:
                self.rejected += 1
                return
            self._last, self.command = packet.sequence, packet.body
            if packet.body.answers:
                self.round_trip_s = (now_ns - packet.body.answers_time_ns) * 1e-9
            if self.follower is not None:
                self.follower.take(packet.body, now_ns)
        else:
            self.rejected += 1

    def _send(self, kind: Type, body: State | None, time_ns: int | None) -> None:
        self.sequence += 1
        data = protocol.encode(
            kind, body, session=self.session, sequence=self.sequence,
            challenge=0 if kind is Type.HELLO else self.challenge,
            time_ns=self._clock_ns() if time_ns is None else time_ns, key=self._key,
        )  # fmt: skip
        try:
            self._udp.send(data)
        except (BlockingIOError, ConnectionError):
            return  # as good as lost on the way
