"""Packets: every field survives, any changed bit is found, and document, C header and Python agree."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import hypothesis
import hypothesis.strategies as st
import pytest

from mjx_cutting.deploy import protocol
from mjx_cutting.deploy.protocol import Cause, Command, Mode, Packet, Reject, State, Type, Welcome

ROOT = Path(__file__).resolve().parents[2]
HEADER = ROOT / "mjx_cutting" / "deploy" / "protocol.h"
DOCUMENT = ROOT / "docs" / "protocol.md"
EXAMPLE_KEY = b"example key"

BODIES: dict[Type, protocol.Body] = {
    Type.HELLO: None,
    Type.STOP: None,
    Type.STATE: State(
        17, 41, (0.0005, -0.001, 0.00025), (0.0, -0.0125, 0.0), (0.52, 0.25, 0.109), (1.5, -8.0, 3.25),
        0.0125, 0.05, 0.02, 0.0, 19.0,
    ),
    Type.COMMAND: Command(
        2001, Mode.RUNNING, Cause.NONE, 20000, 60000, 4_000_000_000, (2450.0, 2080.0, 530.0, 0.25, 0.001)
    ),
    Type.WELCOME: Welcome(
        bytes(range(32)), 20000, 60000, 0.0125, (50.0, 50.0, 50.0, -0.8, 0.0),
        (3000.0, 3000.0, 3000.0, 1.0, 0.002), (4.1, 4.1, 4.1, 2.0, 0.0), (2450.0, 2080.0, 530.0, 0.0, 0.0),
    ),
}  # fmt: skip
NUMBERS = {"session": 0x11223344, "sequence": 2001, "challenge": 0x0123456789ABCDEF, "time_ns": 4_000_000_000}


@pytest.mark.parametrize("key", [None, b"k", b"x" * 100], ids=["unsigned", "short key", "long key"])
@pytest.mark.parametrize("kind", BODIES)
def test_what_is_encoded_is_decoded(kind: Type, key: bytes | None) -> None:
    data = protocol.encode(kind, BODIES[kind], **NUMBERS, key=key)
    assert len(data) == protocol.SIZES[kind]
    assert protocol.decode(data, key) == Packet(kind, *NUMBERS.values(), BODIES[kind])
    assert protocol.decode(data, b"another key") is Reject.KEY


def test_a_signed_packet_needs_the_key_and_an_unsigned_one_is_refused_where_a_key_is_set() -> None:
    signed = protocol.encode(Type.ARM, **NUMBERS, key=b"k")
    assert protocol.decode(signed) is Reject.KEY
    assert protocol.decode(protocol.encode(Type.ARM, **NUMBERS), b"k") is Reject.KEY


@pytest.mark.parametrize("key", [None, b"k"])
@pytest.mark.parametrize("kind", BODIES)
def test_any_flipped_bit_is_found(kind: Type, key: bytes | None) -> None:
    data = protocol.encode(kind, BODIES[kind], **NUMBERS, key=key)
    for bit in range(8 * len(data)):
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        assert isinstance(protocol.decode(bytes(flipped), key), Reject), f"bit {bit}"


@hypothesis.given(st.binary(max_size=400), st.sampled_from([None, b"k"]))
@hypothesis.settings(max_examples=300, deadline=None)
def test_any_bytes_are_refused_without_raising(data: bytes, key: bytes | None) -> None:
    assert isinstance(protocol.decode(b"MJXC" + data, key), Reject)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_a_number_that_is_not_finite_is_refused(value: float) -> None:
    state, command = BODIES[Type.STATE], BODIES[Type.COMMAND]
    assert isinstance(state, State) and isinstance(command, Command)
    for name in ("path_error_m", "force_n"):
        data = protocol.encode(Type.STATE, state._replace(**{name: (0.0, value, 0.0)}), **NUMBERS)
        assert protocol.decode(data) is Reject.VALUE
    bad = command._replace(set_point=(1.0, 1.0, 1.0, 1.0, value))
    assert protocol.decode(protocol.encode(Type.COMMAND, bad, **NUMBERS)) is Reject.VALUE


@pytest.mark.parametrize("change", [{"session": 0}, {"sequence": 0}])
def test_session_and_sequence_zero_are_refused(change: dict[str, int]) -> None:
    assert protocol.decode(protocol.encode(Type.ARM, **{**NUMBERS, **change})) is Reject.FIELD


@pytest.mark.parametrize(
    ("kind", "body", "change"),
    [
        (Type.STATE, None, {}),
        (Type.ARM, BODIES[Type.STATE], {}),
        (Type.HELLO, None, {"sequence": 2**32}),
        (Type.HELLO, None, {"time_ns": -1}),
    ],
)
def test_what_does_not_fit_is_said(kind: Type, body: protocol.Body, change: dict[str, int]) -> None:
    with pytest.raises(ValueError, match=kind.name):
        protocol.encode(kind, body, **{**NUMBERS, **change})


def dumps() -> list[bytes]:
    """The hex dumps of the document, in order."""
    blocks = re.findall(r"```\n(000000 .*?)```", DOCUMENT.read_text(), re.DOTALL)
    return [bytes.fromhex("".join(line[8:] for line in block.splitlines())) for block in blocks]


def test_the_documented_example_decodes() -> None:
    state, command = dumps()
    assert protocol.decode(state, EXAMPLE_KEY) == Packet(Type.STATE, *NUMBERS.values(), BODIES[Type.STATE])
    got = protocol.decode(command)
    assert isinstance(got, Packet)
    assert (got.sequence, got.time_ns, got.body) == (202, 9_000_000_000, BODIES[Type.COMMAND])


def documented_fields() -> dict[str, list[tuple[str, int, int]]]:
    """Struct name -> (field, offset, bytes) of the document's tables."""
    found: dict[str, list[tuple[str, int, int]]] = {}
    for section in DOCUMENT.read_text().split("\n## ")[1:]:
        rows = re.findall(r"^\| (\d+) \| (\d+) \| (\w+) \|", section, re.MULTILINE)
        if rows:
            found[re.split(r"[,:]", section)[0].lower()] = [(name, int(at), int(n)) for at, n, name in rows]
    return found


PROGRAM = """
#include <stdio.h>
#include "protocol.h"
#define FIELD(s, f) printf("%s %s %zu %zu\\n", #s, #f, offsetof(struct mjxc_##s, f), \
sizeof(((struct mjxc_##s *)0)->f));
int main(int argc, char **argv)
{
    static unsigned char buffer[512];
    size_t size;
    const char *key = argc > 1 && argv[1][0] ? argv[1] : NULL;
    size_t key_size = key ? strlen(key) : 0;
    struct mjxc_state s = {0};
    FIELDS
    s.flags = 17; s.command_sequence = 41;
    s.path_error_m[0] = .0005; s.path_error_m[1] = -.001; s.path_error_m[2] = .00025;
    s.velocity_m_s[1] = -.0125;
    s.position_m[0] = .52; s.position_m[1] = .25; s.position_m[2] = .109;
    s.force_n[0] = 1.5; s.force_n[1] = -8; s.force_n[2] = 3.25;
    s.speed_along_m_s = .0125; s.path_m = .05; s.cut_length_m = .02; s.spindle_speed_rev_s = 19;
    mjxc_seal(&s, sizeof s, MJXC_STATE, 0x11223344, 0x0123456789ABCDEFull, 2001, 4000000000ull,
              key, key_size);
    for (size_t i = 0; i < sizeof s; i++) printf("%02x", ((unsigned char *)&s)[i]);
    printf("\\n");
    while (fread(&size, sizeof size, 1, stdin) == 1 && fread(buffer, 1, size, stdin) == size)
        printf("%d\\n", mjxc_check(buffer, size, key, key_size));
    return 0;
}
"""


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("protocol")
    fields = "".join(
        f"FIELD({struct}, {name}) " for struct, rows in documented_fields().items() for name, _, _ in rows
    )
    (folder / "main.c").write_text(PROGRAM.replace("FIELDS", fields))
    flags = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "-pedantic", "-fsanitize=undefined"]
    line = ["gcc", *flags, f"-I{HEADER.parent}", "main.c", "-o", "main", "-lm"]
    done = subprocess.run(line, cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return folder / "main"


def run(program: Path, key: bytes, packets: list[bytes]) -> list[str]:
    given = b"".join(len(packet).to_bytes(8, "little") + packet for packet in packets)
    done = subprocess.run([program, key], input=given, capture_output=True, timeout=60)
    assert done.returncode == 0 and not done.stderr, done.stderr
    return done.stdout.decode().splitlines()


def test_c_structs_have_the_documented_layout(program: Path) -> None:
    printed = [line.split() for line in run(program, b"", []) if line.count(" ") == 3]
    got = {(struct, name): (int(at), int(n)) for struct, name, at, n in printed}
    wanted = {(s, name): (at, n) for s, rows in documented_fields().items() for name, at, n in rows}
    assert got == wanted
    assert {name for name, _ in wanted} == {"header", "trailer", "welcome", "state", "command"}


def test_the_header_compiles_as_cpp(tmp_path: Path) -> None:
    (tmp_path / "main.cpp").write_text('#include "protocol.h"\nint main() { return 0; }\n')
    line = ["g++", "-std=c++11", "-Wall", "-Werror", f"-I{HEADER.parent}", "main.cpp", "-o", "main"]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("key", [b"", EXAMPLE_KEY, b"y" * 80], ids=["unsigned", "short key", "long key"])
def test_c_and_python_seal_and_check_alike(program: Path, key: bytes) -> None:
    good = [protocol.encode(kind, body, **NUMBERS, key=key or None) for kind, body in BODIES.items()]
    state = BODIES[Type.STATE]
    assert isinstance(state, State)
    given = [*good, b"", good[0][:-1], protocol.encode(Type.ARM, **NUMBERS, key=b"stranger")]
    given.append(protocol.encode(Type.ARM, **{**NUMBERS, "session": 0}, key=key or None))
    bad = state._replace(force_n=(0.0, 0.0, float("nan")))
    given.append(protocol.encode(Type.STATE, bad, **NUMBERS, key=key or None))
    for packet in good:
        for at in range(0, len(packet), 3):
            given.append(packet[:at] + bytes([packet[at] ^ 0x41]) + packet[at + 1 :])
    lines = [line for line in run(program, key, given) if line.count(" ") == 0]
    assert bytes.fromhex(lines[0]) == protocol.encode(Type.STATE, state, **NUMBERS, key=key or None)
    told = [protocol.decode(packet, key or None) for packet in given]
    assert [int(line) for line in lines[1:]] == [
        -answer if isinstance(answer, Reject) else answer.type for answer in told
    ]
