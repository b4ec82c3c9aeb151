"""The policy server without its sockets: packets and time in, packets out.

`handle` takes one datagram, `tick` makes one COMMAND every policy period; both are told the time, so a test
can run hours in a second, and nothing here can block. What a packet must pass, in this order, before anything
acts on it: `protocol.decode` (size, CRC, key, finite numbers), peer, session and challenge, sequence, time,
plausible values. Whatever fails is counted under its reason and changes nothing else.

The challenge is a keyed hash of the peer's address and session and of how many peers there were, so a HELLO
leaves no trace here, a flood of them fills nothing, and no conversation can be replayed after its end.
"""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import secrets
import struct
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from mjx_cutting.deploy import protocol
from mjx_cutting.deploy.latency import Histogram
from mjx_cutting.deploy.observing import Observer
from mjx_cutting.deploy.protocol import Cause, Command, Mode, Packet, Reject, State, Type, Welcome
from mjx_cutting.deploy.runtime import PolicyRuntime
from mjx_cutting.deploy.safety import Limits, Safety, plausible

# isort: split
import numpy as np

Address = tuple[str, int]
NEVER_S = 1e9
WINDOW = 64
"""Sequence numbers back to which a packet seen twice is told from one that was overtaken."""

REJECTED = (
    *(reason.name.lower() for reason in Reject),
    "direction", "unknown_peer", "wrong_session", "duplicate", "reordered", "replayed", "time", "range",
)  # fmt: skip
"""Reasons for not acting on a packet."""


@dataclass(frozen=True)
class Settings:
    """What may be set about a server.

    Arguments: limits; key, None for unsigned packets; nominal_feed_m_s; force_samples averaged into one
    observation, as in training; release_s of silence after which another peer may take the place.
    """

    limits: Limits = field(default_factory=Limits)
    key: bytes | None = None
    nominal_feed_m_s: float = 0.0125
    force_samples: int = 10
    release_s: float = 1.0


class Peer:
    """The controller being served."""

    def __init__(self, address: Address, session: int, challenge: int):
        self.address, self.session, self.challenge = address, session, challenge
        self.last = 0
        self.seen = 0
        self.state_time_ns = -1
        self.heard_ns = 0
        self.sent = 0

    def order(self, sequence: int) -> str | None:
        """None for a packet newer than all before, which it then is; else what it is."""
        if sequence > self.last:
            ahead = sequence - self.last
            self.seen = ((self.seen << ahead) | 1) & (2**WINDOW - 1) if ahead < WINDOW else 1
            self.last = sequence
            return None
        back = self.last - sequence
        if back >= WINDOW:
            return "replayed"
        if self.seen >> back & 1:
            return "duplicate"
        self.seen |= 1 << back
        return "reordered"


class Server:
    """One policy, one peer.

    Arguments:
        runtime: the policy.
        settings: key, limits, and what the policy's file does not say.
        log: called with one line at every transition and event; must not block.
        record: called with (time_ns, State, set-points [5], trial number) for each sample while RUNNING.

    Raises:
        ValueError: the policy's observations or actions are not those of the protocol.
    """

    def __init__(
        self,
        runtime: PolicyRuntime,
        settings: Settings,
        log: Callable[[str], None],
        record: Callable[[int, State, np.ndarray, int], None] | None = None,
    ):
        self.settings, self._log, self._record = settings, log, record
        self.counts = dict.fromkeys(("accepted", *REJECTED), 0)
        self.commands = self.held = self.trials = self.swaps = self.swaps_refused = 0
        self.peer: Peer | None = None
        self._secret, self._epoch = secrets.token_bytes(32), 0
        self._forces: deque[tuple[float, float, float]] = deque(maxlen=settings.force_samples)
        self._state: State | None = None
        self._install(runtime)

    @property
    def mode(self) -> Mode:
        """State of the safety state machine."""
        return self.safety.mode

    @property
    def moving(self) -> bool:
        """Whether the robot may be moving: RUNNING or SAFE_STOP."""
        return self.mode in (Mode.RUNNING, Mode.SAFE_STOP)

    # -- packets in

    def handle(self, data: bytes, address: Address, now_ns: int) -> bytes | None:
        """Takes one datagram; returns what to answer at once (a WELCOME), or None."""
        packet = protocol.decode(data, self.settings.key)
        if isinstance(packet, Reject):
            self.counts[packet.name.lower()] += 1
            return None
        if packet.type in (Type.WELCOME, Type.COMMAND):
            self.counts["direction"] += 1
            return None
        if packet.type is Type.HELLO:
            return self._hello(packet, address, now_ns)
        reason = self._refuse(packet, address, now_ns)
        if reason is not None:
            self.counts[reason] += 1
            return None
        self.counts["accepted"] += 1
        self._act(packet, now_ns)
        return None

    def _hello(self, packet: Packet, address: Address, now_ns: int) -> bytes | None:
        peer = self.peer
        if peer is not None and (self.moving or now_ns - peer.heard_ns < self.settings.release_s * 1e9):
            self.counts["wrong_session" if peer.address == address else "unknown_peer"] += 1
            return None
        challenge = self._challenge(address, packet.session)
        return protocol.encode(
            Type.WELCOME, self._welcome, session=packet.session, sequence=1, challenge=challenge,
            time_ns=now_ns, key=self.settings.key,
        )  # fmt: skip

    def _refuse(self, packet: Packet, address: Address, now_ns: int) -> str | None:
        """Why a packet is not acted on; None if it is, and then it is the peer's newest."""
        peer = self.peer
        if peer is not None and (peer.address, peer.session, peer.challenge) != (
            address, packet.session, packet.challenge,
        ):  # fmt: skip
            if self.moving or now_ns - peer.heard_ns < self.settings.release_s * 1e9:
                return "unknown_peer" if peer.address != address else "wrong_session"
            peer = None
        if peer is None:
            if packet.challenge != self._challenge(address, packet.session):
                return "wrong_session"
            peer = Peer(address, packet.session, packet.challenge)
        if isinstance(packet.body, State):
            if not plausible(packet.body):
                return "range"
            if packet.sequence > peer.last and packet.time_ns <= peer.state_time_ns:
                return "time"
        reason = peer.order(packet.sequence)
        if reason is None and peer is not self.peer:
            self._bind(peer)
        return reason

    def _bind(self, peer: Peer) -> None:
        self.release()
        self.peer = peer
        self._forget()
        self._log(f"peer {peer.address[0]}:{peer.address[1]}, session {peer.session:#010x}")

    def release(self) -> None:
        """Forgets the peer, whose challenge is then worth nothing; ARMED becomes IDLE, FAULT stays."""
        self._epoch += 1
        self.peer = None
        self.safety.stop()

    def _act(self, packet: Packet, now_ns: int) -> None:
        assert self.peer is not None
        self.peer.heard_ns = now_ns
        if isinstance(packet.body, State):
            self._sample(packet, packet.body, now_ns)
        elif packet.type is Type.ARM:
            self.safety.arm((now_ns - self._state_ns) / 1e9 if self._state else NEVER_S)
        elif packet.type is Type.START:
            before = self.mode
            self.safety.start()
            self.trials += self.mode is not before
        elif packet.type is Type.STOP:
            self.safety.stop()
        elif packet.type is Type.DISARM:
            self.safety.disarm()

    def _sample(self, packet: Packet, state: State, now_ns: int) -> None:
        assert self.peer is not None
        self.peer.state_time_ns = packet.time_ns
        self._state, self._state_ns = state, now_ns
        self._answers, self._answers_time_ns = packet.sequence, packet.time_ns
        self._forces.append(state.force_n)
        self.safety.sample(state)
        if self._record is not None and self.mode is Mode.RUNNING:
            self._record(packet.time_ns, state, self._set_point, self.trials)

    # -- packets out

    def tick(self, now_ns: int, late_s: float = 0.0) -> bytes | None:
        """Returns the COMMAND of this policy period; None where there is no peer.

        Arguments: now_ns; late_s, by how much this call missed its time.
        """
        safety = self.safety
        age_s = (now_ns - self._state_ns) / 1e9 if self._state else NEVER_S
        fresh = safety.watch(age_s, late_s)
        wish = None
        if safety.policy_acts and self._state is not None:
            if fresh:
                wish = self._decide(self._state)
            else:
                self.held += 1
        safety.advance(wish)
        self._set_point = safety.set_point
        if self.peer is None:
            return None
        self.peer.sent += 1
        self.commands += 1
        body = Command(
            self._answers, safety.mode, safety.cause, self._welcome.period_us, self._welcome.hold_us,
            self._answers_time_ns, tuple(self._set_point.tolist()),
        )  # fmt: skip
        return protocol.encode(
            Type.COMMAND, body, session=self.peer.session, sequence=self.peer.sent,
            challenge=self.peer.challenge, time_ns=now_ns, key=self.settings.key,
        )  # fmt: skip

    def rehearse(self) -> None:
        """Runs the policy for nothing, so that a moment later its code and weights are in the cache."""
        if self.safety.policy_acts and self._state is not None:
            with contextlib.suppress(ValueError, FloatingPointError):  # `tick` will meet it again, and act
                observation = self._observer(self._state, self._forces, self._set_point)
                self.runtime.advance(self._set_point, self.runtime(observation))

    def _decide(self, state: State) -> np.ndarray | None:
        try:
            observation = self._observer(state, self._forces, self._set_point)
            return self.runtime.advance(self._set_point, self.runtime(observation))
        except (ValueError, FloatingPointError) as error:
            self._log(f"policy: {error}")
            self.safety.stop(Cause.POLICY)
            return None

    # -- the policy

    def swap(self, runtime: PolicyRuntime) -> bool:
        """Serves another policy from now on, whole; False, and nothing changes, unless it is IDLE.

        The peer is released, for it was welcomed with the limits of the policy before.

        Raises:
            ValueError: the policy's observations or actions are not those of the protocol.
        """
        if self.mode is not Mode.IDLE:
            self.swaps_refused += 1
            self._log(f"new policy refused in {self.mode.name}: stop and disarm first")
            return False
        self.release()
        self._install(runtime)
        self.swaps += 1
        self._log(f"new policy {runtime.artefact.sha256[:16]}")
        return True

    def _install(self, runtime: PolicyRuntime) -> None:
        artefact, settings = runtime.artefact, self.settings
        observer = Observer(artefact)
        for _ in range(3):  # the first calls are slow
            runtime(artefact.golden_observation[0])
        self.runtime, self._observer = runtime, observer
        self.safety = Safety(artefact, settings.limits, self._log)
        self.latency = Histogram(deadline_s=artefact.policy_period_s)
        self._welcome = Welcome(
            bytes.fromhex(artefact.sha256),
            round(artefact.policy_period_s * 1e6),
            round(settings.limits.hold_s * 1e6),
            settings.nominal_feed_m_s,
            artefact.action_low,
            artefact.action_high,
            tuple(rate if np.isfinite(rate) else 0.0 for rate in artefact.action_rate_per_s),
            artefact.action_initial,
        )
        self._forget()

    def _forget(self) -> None:
        self._forces.clear()
        self._state = None
        self._state_ns = self._answers = self._answers_time_ns = 0
        self._set_point = self.safety.set_point

    def _challenge(self, address: Address, session: int) -> int:
        text = f"{self._epoch} {address[0]} {address[1]} {session}".encode()
        digest = hmac.digest(self._secret, text, hashlib.sha256)
        value: int = struct.unpack("<Q", digest[:8])[0]
        return value
