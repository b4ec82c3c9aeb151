"""Packets that nobody should act on: random bytes, and good packets cut, spliced, flipped or forged.

For fuzzing a server or a controller's own parser. A forged packet has its CRC set right, so that only what
comes after the CRC can refuse it: the key, or the peer, session, sequence and values.
"""

from __future__ import annotations

import random
import struct
import zlib
from collections.abc import Iterator, Sequence

from mjx_cutting.deploy.protocol import MAGIC, SIZE_AT_MOST, SIZES

_TRAILER_BYTES = 40
_INTERESTING = tuple(
    struct.pack("<d", value)
    for value in (float("nan"), float("inf"), -float("inf"), 1e308, -1e9, 1e-320, 0.0)
)


def packets(good: Sequence[bytes], seed: int = 0) -> Iterator[bytes]:
    """Yields hostile packets without end.

    Arguments: good, packets to start from; seed.
    """
    draw = random.Random(seed)
    sizes = tuple(SIZES.values())
    while True:
        way = draw.randrange(8)
        packet = bytearray(draw.choice(good))
        if way == 0:
            yield draw.randbytes(draw.randrange(2 * SIZE_AT_MOST))
        elif way == 1:
            head = MAGIC + bytes([draw.randrange(3), draw.randrange(12)])
            yield head + draw.randbytes(draw.choice(sizes) - len(head))
        elif way == 2:
            yield bytes(packet[: draw.randrange(len(packet))])
        elif way == 3:
            yield bytes(packet) + draw.randbytes(1 + draw.randrange(64))
        elif way == 4:
            other = draw.choice(good)
            cut = draw.randrange(1, len(packet))
            yield bytes(packet[:cut]) + other[cut:] if other[cut:] != packet[cut:] else other[:-1]
        elif way == 5:
            for _ in range(1 + draw.randrange(8)):
                packet[draw.randrange(len(packet))] ^= 1 << draw.randrange(8)
            yield bytes(packet)
        else:
            yield _forged(packet, draw)


def _forged(packet: bytearray, draw: random.Random) -> bytes:
    end = len(packet) - _TRAILER_BYTES
    if end > 40 and draw.random() < 0.5:
        at = 40 + 8 * draw.randrange((end - 40) // 8)
        packet[at : at + 8] = draw.choice(_INTERESTING)
    else:
        at = draw.randrange(4, end)
        packet[at] = draw.randrange(256)
    struct.pack_into("<I", packet, end, zlib.crc32(packet[:end]))
    return bytes(packet)
