"""Random and mutated packets: no crash, no action, no memory kept."""

from __future__ import annotations

import gc
import itertools
import socket
import tracemalloc

import pytest

from mjx_cutting.deploy import hostile, protocol
from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.client import Client
from mjx_cutting.deploy.protocol import Mode, Packet, Robot, State, Type, Welcome
from mjx_cutting.deploy.runtime import PolicyRuntime
from mjx_cutting.deploy.server import Server, Settings

KEY = b"0123456789abcdef"
HERE, THERE = ("127.0.0.1", 4000), ("127.0.0.1", 4001)
STILL = (0.0, 0.0, 0.0)
READY = State(Robot.READY, 0, STILL, STILL, (0.5, 0.3, 0.1), (1.0, 2.0, 3.0), 0.0125, 0.0, 0.0, 0.0, 0.0)


def running(artefact: Artefact, key: bytes | None) -> tuple[Server, list[bytes]]:
    """A server in a running cut, and the packets that led there."""
    server = Server(PolicyRuntime(artefact), Settings(key=key), lambda line: None)
    numbers = {"session": 9, "time_ns": 1, "key": key}
    hello = protocol.encode(Type.HELLO, sequence=1, challenge=0, **numbers)
    welcome = protocol.decode(server.handle(hello, HERE, 0) or b"", key)
    assert isinstance(welcome, Packet) and isinstance(welcome.body, Welcome)
    good = [hello]
    for at, kind in enumerate((Type.STATE, Type.ARM, Type.START), 2):
        body = READY if kind is Type.STATE else None
        good.append(protocol.encode(kind, body, sequence=at, challenge=welcome.challenge, **numbers))
        server.handle(good[-1], HERE, 0)
    assert server.mode is Mode.RUNNING
    return server, good


def snapshot(server: Server) -> tuple[object, ...]:
    peer = server.peer
    assert peer is not None
    return (
        server.mode, server.counts["accepted"], server._state, tuple(server._forces), peer.address,
        peer.session, peer.last, tuple(server.safety.set_point),
    )  # fmt: skip


@pytest.mark.parametrize("count", [20_000, pytest.param(150_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("key", [KEY, None], ids=["signed", "unsigned"])
def test_nothing_is_acted_on_and_nothing_is_kept(served: Artefact, key: bytes | None, count: int) -> None:
    """Signed: from the peer's own address. Unsigned, where the CRC can be forged: from another address."""
    server, good = running(served, key)
    address = HERE if key else THERE
    before = snapshot(server)
    given = hostile.packets(good, seed=1)
    for data in itertools.islice(given, 2000):
        server.handle(data, address, 1)
    tracemalloc.start()
    gc.collect()
    start = tracemalloc.get_traced_memory()[0]
    for data in itertools.islice(given, count):
        assert server.handle(data, address, 1) is None
    del data
    gc.collect()
    grown = tracemalloc.get_traced_memory()[0] - start
    tracemalloc.stop()
    assert snapshot(server) == before
    assert grown < 4096
    refused = {name: n for name, n in server.counts.items() if n and name != "accepted"}
    assert sum(refused.values()) == count + 2000
    assert set(refused) >= {"size", "magic", "version", "type", "crc", "key" if key else "unknown_peer"}


def test_a_forged_packet_of_the_peer_without_a_key_moves_nothing_implausible(served: Artefact) -> None:
    """Without a key the peer itself may send nonsense: it is counted, or it stops; it never crashes."""
    server, good = running(served, None)
    for at, data in enumerate(itertools.islice(hostile.packets(good, seed=2), 20_000)):
        server.handle(data, HERE, at)
        if at % 100 == 0:
            server.tick(at)
        assert all(-1.0 <= value <= 3000.0 for value in server.safety.set_point)


def test_a_client_survives_hostile_answers() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.bind(("127.0.0.1", 0))
        client = Client("127.0.0.1", udp.getsockname()[1], KEY)
        client.ask(Type.HELLO)
        data, address = udp.recvfrom(400)
        for hostile_packet in itertools.islice(hostile.packets([data], seed=3), 2000):
            udp.sendto(hostile_packet, address)
            client.poll()
        assert client.welcome is None and client.command is None and client.rejected == 2000
        client.close()
