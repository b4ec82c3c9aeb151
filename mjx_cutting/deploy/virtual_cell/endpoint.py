"""The controller's end of the UDP conversation, without a socket: bytes in, bytes out.

HELLO until WELCOME; then STATE at 500 Hz, ARM and START until the server runs, STOP when asked to; COMMANDs
are taken only with this session's number and challenge and a sequence above the last one.
"""

from __future__ import annotations

from collections import Counter

from mjx_cutting.deploy.protocol import (
    Command,
    Mode,
    Packet,
    Reject,
    State,
    Type,
    Welcome,
    decode,
    encode,
)

REPEAT_NS = 50_000_000


class Endpoint:
    """One session. Arguments: `session` number, not 0; `key` shared with the server, None for none.

    Fields: `welcome` from the server or None; `mode` in its newest COMMAND; `taken` sequence of that;
    `counts` of packets by what became of them.
    """

    def __init__(self, session: int, key: bytes | None = None):
        self.session, self._key = session, key
        self.welcome: Welcome | None = None
        self.mode, self.taken, self.counts = Mode.IDLE, 0, Counter[str]()
        self.wish: Mode | None = Mode.RUNNING
        self._challenge, self._sequence, self._heard, self._asked_ns = 0, 0, 0, -REPEAT_NS
        self._ran = False

    def receive(self, data: bytes) -> Command | Welcome | None:
        """The COMMAND or WELCOME in a datagram, where it is to be acted on."""
        packet = decode(data, self._key)
        if isinstance(packet, Reject):
            self.counts[packet.name.lower()] += 1
            return None
        body = packet.body
        if isinstance(body, Welcome) and packet.session == self.session:
            if self.welcome is not None:
                return None
            self.welcome, self._challenge = body, packet.challenge
            return body
        if isinstance(body, Command) and self._mine(packet):
            self._heard = self.taken = packet.sequence
            self.mode = body.mode
            self._ran |= body.mode is Mode.RUNNING
            self.counts["command"] += 1
            return body
        self.counts["not mine"] += 1
        return None

    def ask(self, now_ns: int) -> bytes | None:
        """The packet that asks for what is wanted next (HELLO, ARM, START, STOP), 20 times a second."""
        kind = self._next()
        if kind is None or now_ns - self._asked_ns < REPEAT_NS:
            return None
        self._asked_ns = now_ns
        return self._packet(kind, None, now_ns)

    def state(self, state: State, now_ns: int) -> bytes | None:
        """The STATE packet; None before the server's WELCOME."""
        return None if self.welcome is None else self._packet(Type.STATE, state, now_ns)

    def _next(self) -> Type | None:
        if self.welcome is None:
            return Type.HELLO
        if self.wish is Mode.RUNNING and not self._ran:
            if self.counts["state"] == 0:
                return None  # the server arms nobody it has no measurement of
            return {Mode.IDLE: Type.ARM, Mode.FAULT: Type.ARM, Mode.ARMED: Type.START}.get(self.mode)
        if self.wish is Mode.IDLE:
            return {Mode.RUNNING: Type.STOP, Mode.ARMED: Type.DISARM, Mode.FAULT: Type.DISARM}.get(self.mode)
        return None

    def _packet(self, kind: Type, body: State | None, now_ns: int) -> bytes:
        self._sequence += 1
        self.counts[kind.name.lower()] += 1
        challenge = 0 if kind is Type.HELLO else self._challenge
        return encode(
            kind, body, session=self.session, sequence=self._sequence, challenge=challenge, time_ns=now_ns,
            key=self._key,
        )  # fmt: skip

    def _mine(self, packet: Packet) -> bool:
        return (
            self.welcome is not None
            and packet.session == self.session
            and packet.challenge == self._challenge
            and packet.sequence > self._heard
        )
