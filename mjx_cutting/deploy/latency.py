"""A latency histogram of fixed size: buckets 1 % wide from 1 us to 10 s, and the exact largest value.

Adding a value is a few integer operations and allocates nothing that stays, so it can stand in a real-time
loop for weeks. Quantiles are read to within 1 %.
"""

from __future__ import annotations

import math

_LOWEST_S = 1e-6
_WIDTH = math.log(1.01)
_BUCKETS = math.ceil(math.log(1e7) / _WIDTH) + 1


class Histogram:
    """Latencies in seconds.

    Arguments:
        deadline_s: a longer latency counts as missed.
    """

    def __init__(self, deadline_s: float = math.inf):
        self.deadline_s = deadline_s
        self.count = 0
        self.missed = 0
        self.largest_s = 0.0
        self.sum_s = 0.0
        self._counts = [0] * _BUCKETS

    def add(self, latency_s: float) -> None:
        """Counts one latency; one below 1 us counts as 1 us, one above 10 s as 10 s (but for the largest)."""
        self.count += 1
        self.sum_s += latency_s
        if latency_s > self.largest_s:
            self.largest_s = latency_s
        if latency_s > self.deadline_s:
            self.missed += 1
        bucket = int(math.log(latency_s / _LOWEST_S) / _WIDTH) if latency_s > _LOWEST_S else 0
        self._counts[min(bucket, _BUCKETS - 1)] += 1

    def quantile(self, q: float) -> float:
        """Returns the latency, s, that the fraction q in [0, 1] does not exceed; 0 where none was counted."""
        wanted, seen = max(1, math.ceil(q * self.count)), 0
        for bucket, count in enumerate(self._counts):
            seen += count
            if count and seen >= wanted:
                return min(_LOWEST_S * math.exp(_WIDTH * (bucket + 1)), self.largest_s)
        return 0.0

    def __str__(self) -> str:
        """One line: quantiles in microseconds and deadlines missed."""
        p50, p99, p999 = (1e6 * self.quantile(q) for q in (0.5, 0.99, 0.999))
        return (
            f"latency p50 {p50:.0f}, p99 {p99:.0f}, p99.9 {p999:.0f}, largest {self.largest_s * 1e6:.0f} us; "
            f"{self.missed} deadlines missed"
        )

    def below(self, latency_s: float) -> int:
        """Returns how many latencies lay below this one, to within a bucket."""
        if latency_s <= _LOWEST_S:
            return 0
        return sum(self._counts[: int(math.log(latency_s / _LOWEST_S) / _WIDTH) + 1])
