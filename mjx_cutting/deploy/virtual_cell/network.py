"""A bad cable: packets that are lost, and packets that come late and out of order (hidden effect)."""

from __future__ import annotations

import heapq
import itertools

import numpy as np

from mjx_cutting.deploy.virtual_cell.hidden import Network


class Wire:
    """One direction. Arguments: `network` effect, `seed`."""

    def __init__(self, network: Network, seed: int):
        self._network, self._draw = network, np.random.default_rng(seed)
        self._queue: list[tuple[int, int, bytes]] = []
        self._count = itertools.count()

    def put(self, data: bytes, now_ns: int) -> None:
        """Sends a packet, or loses it."""
        if self._draw.random() >= self._network.loss:
            late = int(1e9 * self._network.jitter_s * self._draw.random())
            heapq.heappush(self._queue, (now_ns + late, next(self._count), data))

    def take(self, now_ns: int) -> list[bytes]:
        """The packets that have arrived by now."""
        found = []
        while self._queue and self._queue[0][0] <= now_ns:
            found.append(heapq.heappop(self._queue)[2])
        return found
