"""The UDP packets between a robot's controller and the policy server: fixed sizes, little-endian.

    header   32 bytes   magic "MJXC", version, type, flags, session, sequence, challenge, time_ns
    payload             of the type; a multiple of 8 bytes, all fields naturally aligned
    trailer  40 bytes   CRC-32 of all before it, four zero bytes, HMAC-SHA256 of all before the tag (or zeros)

The conversation. The controller draws a session number and says HELLO until WELCOME comes with the server's
challenge; every later packet of either side carries both numbers, so no packet of another session, recorded
or forged without the key, is taken. The controller then sends STATE at its sensor's rate; the server answers
with COMMAND at the policy's rate, in every state. ARM, START, STOP and DISARM ask for a change of state and
are repeated until a COMMAND shows it. Each side counts its own packets in `sequence` from 1, never back and
never around (2^32 packets last 99 days at 500 Hz). Times are the sender's own monotonic clock and are never
compared with the other's. docs/protocol.md has the layout byte by byte, protocol.h the same in C99.

The key is shared beforehand. It shows who sent a packet; it hides nothing.
"""

from __future__ import annotations

import enum
import hmac
import math
import struct
import zlib
from typing import NamedTuple, TypeAlias

MAGIC = b"MJXC"
VERSION = 1
SIGNED = 0x0001
"""Flag in the header: the tag is the HMAC-SHA256 under the shared key. Without it the tag is zeros."""

SEQUENCE_AT_MOST = 2**32 - 1
DEFAULT_PORT = 50500


class Type(enum.IntEnum):
    """What a packet is."""

    HELLO = 1
    WELCOME = 2
    ARM = 3
    START = 4
    STOP = 5
    DISARM = 6
    STATE = 7
    COMMAND = 8


class Mode(enum.IntEnum):
    """State of the server's safety state machine, in every COMMAND."""

    IDLE = 0
    ARMED = 1
    RUNNING = 2
    SAFE_STOP = 3
    FAULT = 4


class Cause(enum.IntEnum):
    """Why the server left RUNNING, or refused to go there."""

    NONE = 0
    REQUESTED = 1
    FINISHED = 2
    STALE = 3
    FORCE = 4
    DEVIATION = 5
    ROBOT = 6
    RANGE = 7
    POLICY = 8
    SHUTDOWN = 9
    OVERRUN = 10


class Robot(enum.IntFlag):
    """Flags of a STATE."""

    READY = 1
    """Drives on, cell closed, program waiting for set-points."""
    FAULT = 2
    """Emergency stop, or any fault of the robot's own."""
    FINISHED = 4
    """The end of the path was reached."""
    SPINDLE_ANGLE = 8
    """`spindle_angle_rad` is measured; else it is 0."""
    SPINDLE_SPEED = 16
    """`spindle_speed_rev_s` is measured; else it is 0."""


class Reject(enum.IntEnum):
    """Why bytes are no packet to act on; found in this order."""

    SIZE = 1
    MAGIC = 2
    VERSION = 3
    TYPE = 4
    CRC = 5
    KEY = 6
    FIELD = 7
    VALUE = 8


class Welcome(NamedTuple):
    """The server's answer to HELLO: what it will send, and within which limits.

    Arguments: policy_sha256, 32 bytes; period_us of the policy; hold_us, how long a COMMAND's set-points may
    be held when no newer one comes; nominal_feed_m_s, so that feed = nominal x (1 + feed_adjustment); low,
    high, rate_per_s and initial of the five set-points (rates of the gains are of their logarithm; 0 stands
    for unlimited). Set-points of a stop leave `low`: the feed adjustment goes to -1.
    """

    policy_sha256: bytes
    period_us: int
    hold_us: int
    nominal_feed_m_s: float
    low: tuple[float, ...]
    high: tuple[float, ...]
    rate_per_s: tuple[float, ...]
    initial: tuple[float, ...]


class State(NamedTuple):
    """One sample of the robot and its force sensor; the header's time is the sample's. Base axes, SI.

    Arguments: flags of `Robot`; command_sequence of the newest COMMAND taken, 0 before the first;
    path_error_m [3], reference minus actual TCP position; velocity_m_s [3] and position_m [3] of the TCP;
    force_n [3] on the tool, one raw sample; speed_along_m_s along the path; path_m, travelled along the path;
    cut_length_m, cut by this tool so far; spindle_angle_rad; spindle_speed_rev_s.
    """

    flags: int
    command_sequence: int
    path_error_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float, float]
    position_m: tuple[float, float, float]
    force_n: tuple[float, float, float]
    speed_along_m_s: float
    path_m: float
    cut_length_m: float
    spindle_angle_rad: float
    spindle_speed_rev_s: float


class Command(NamedTuple):
    """Set-points for the controller, which interpolates to them over `period_us` at its own rate.

    Arguments: answers, sequence of the newest STATE used, and answers_time_ns, that packet's own time (0
    before the first); mode, cause; period_us; hold_us after which, without a newer COMMAND, the controller
    stops by itself; set_point: stiffness x, y, z [s^-2], feed adjustment [1], depth [m].
    """

    answers: int
    mode: Mode
    cause: Cause
    period_us: int
    hold_us: int
    answers_time_ns: int
    set_point: tuple[float, float, float, float, float]


Body: TypeAlias = Welcome | State | Command | None


class Packet(NamedTuple):
    """A decoded packet: header and body (None for HELLO, ARM, START, STOP and DISARM)."""

    type: Type
    session: int
    sequence: int
    challenge: int
    time_ns: int
    body: Body


_HEADER = "<4sBBHIIQQ"
_TRAILER = struct.Struct("<II32s")
_PAYLOADS = {
    Type.HELLO: "", Type.ARM: "", Type.START: "", Type.STOP: "", Type.DISARM: "",
    Type.WELCOME: "32sIId5d5d5d5d",
    Type.STATE: "II3d3d3d3d5d",
    Type.COMMAND: "IBBHIIQ5d",
}  # fmt: skip
_STRUCTS = {kind: struct.Struct(_HEADER + payload) for kind, payload in _PAYLOADS.items()}
_NO_TAG = bytes(32)

SIZES = {kind: layout.size + _TRAILER.size for kind, layout in _STRUCTS.items()}
"""Bytes of a whole packet of each type."""

SIZE_AT_MOST = max(SIZES.values())
_TYPES = {int(kind): kind for kind in Type}
_MODES, _CAUSES = {int(m): m for m in Mode}, {int(c): c for c in Cause}


def encode(
    kind: Type,
    body: Body = None,
    *,
    session: int,
    sequence: int,
    challenge: int,
    time_ns: int,
    key: bytes | None = None,
) -> bytes:
    """Returns the packet's bytes, sealed.

    Arguments: kind and its body; session, sequence and challenge as in the module's text; time_ns of the
    sender's monotonic clock; key, None for an unsigned packet.

    Raises:
        ValueError: a number that does not fit its field, or a body that is not of this kind.
    """
    try:
        fields = _flat(body)
        head = _STRUCTS[kind].pack(
            MAGIC, VERSION, kind, SIGNED if key else 0, session, sequence, challenge, time_ns, *fields
        )
    except (struct.error, TypeError) as error:
        raise ValueError(
            f"got {kind.name} with {body!r} that cannot be packed ({error}); expected the fields and ranges "
            "of docs/protocol.md"
        ) from None
    sealed = head + struct.pack("<II", zlib.crc32(head), 0)
    return sealed + (hmac.digest(key, sealed, "sha256") if key else _NO_TAG)


def decode(data: bytes, key: bytes | None = None) -> Packet | Reject:
    """Returns the packet in these bytes, or why they are none; never raises.

    Arguments: data of one datagram; key, with which the packet must be signed; None: it must be unsigned.
    """
    if len(data) < 72:
        return Reject.SIZE
    if data[:4] != MAGIC:
        return Reject.MAGIC
    if data[4] != VERSION:
        return Reject.VERSION
    kind = _TYPES.get(data[5])
    if kind is None:
        return Reject.TYPE
    layout = _STRUCTS[kind]
    size = layout.size
    if len(data) != size + 40:
        return Reject.SIZE
    crc, reserved, tag = _TRAILER.unpack_from(data, size)
    if zlib.crc32(data[:size]) != crc:
        return Reject.CRC
    _, _, _, flags, session, sequence, challenge, time_ns, *fields = layout.unpack_from(data)
    if key:
        if flags != SIGNED or not hmac.compare_digest(hmac.digest(key, data[:-32], "sha256"), tag):
            return Reject.KEY
    elif flags & SIGNED or tag != _NO_TAG:
        return Reject.KEY
    if reserved or flags & ~SIGNED or sequence == 0 or session == 0:
        return Reject.FIELD
    body = _body(kind, fields)
    return body if isinstance(body, Reject) else Packet(kind, session, sequence, challenge, time_ns, body)


def _flat(body: Body) -> list[object]:
    flat: list[object] = []
    for value in body or ():
        flat.extend(value) if isinstance(value, tuple) else flat.append(value)
    if isinstance(body, Command):
        flat.insert(3, 0)  # reserved
    return flat


def _body(kind: Type, f: list) -> Body | Reject:
    if kind is Type.STATE:
        # a sum is finite unless a term is not, or they overflow; no sensor reads 1e300
        if not math.isfinite(sum(f[2:])):
            return Reject.VALUE
        return State(f[0], f[1], tuple(f[2:5]), tuple(f[5:8]), tuple(f[8:11]), tuple(f[11:14]), *f[14:])
    if kind is Type.COMMAND:
        answers, mode, cause, reserved, period_us, hold_us, answers_time_ns, *set_point = f
        if reserved or mode not in _MODES or cause not in _CAUSES:
            return Reject.FIELD
        if not math.isfinite(sum(set_point)):
            return Reject.VALUE
        return Command(
            answers, _MODES[mode], _CAUSES[cause], period_us, hold_us, answers_time_ns, tuple(set_point)
        )
    if kind is Type.WELCOME:
        if not math.isfinite(sum(f[3:])):
            return Reject.VALUE
        return Welcome(
            f[0], f[1], f[2], f[3], tuple(f[4:9]), tuple(f[9:14]), tuple(f[14:19]), tuple(f[19:24])
        )
    return None
