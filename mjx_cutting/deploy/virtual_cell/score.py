"""What a cut amounted to, in the quantities of the paper's table and reward; weights are the reader's.

Sums over the time from the first RUNNING command to the end of the path or to the stop.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
WINDOW = 20


@dataclass
class Score:
    """Amounts of one cut.

    Fields: `time_s`; `mrv_mm3` volume that the saw's circle left empty, `chips_mm3` that its teeth cut;
    `contact_s`, and `load_n_s`, `deviation_mm_s`, magnitudes summed over the time in contact;
    `error_squared_mm2_s` [3] and `force_squared_n2_s` [3] base axes. Contact, load and its square go by
    windows of 20 ms (teeth come and go within one) and by the mean load of each;
    `worst_load_n`, `worst_deviation_mm`; `saturated_s`; `path_m` travelled; `completed`; `why` it ended.
    """

    time_s: float = 0.0
    mrv_mm3: float = 0.0
    chips_mm3: float = 0.0
    contact_s: float = 0.0
    load_n_s: float = 0.0
    deviation_mm_s: float = 0.0
    error_squared_mm2_s: Array = field(default_factory=lambda: np.zeros(3))
    force_squared_n2_s: Array = field(default_factory=lambda: np.zeros(3))
    worst_load_n: float = 0.0
    worst_deviation_mm: float = 0.0
    saturated_s: float = 0.0
    path_m: float = 0.0
    completed: bool = False
    why: str = ""
    _load: Array = field(default_factory=lambda: np.zeros(3))
    _count: int = 0
    _touched: bool = False

    def add(
        self,
        load_n: Array,
        error_m: Array,
        contact: bool,
        removed_mm3: float,
        chips_mm3: float,
        saturated: bool,
    ) -> None:
        """One millisecond."""
        self.time_s += 1e-3
        self.mrv_mm3 += removed_mm3
        self.chips_mm3 += chips_mm3
        self.error_squared_mm2_s += 1e3 * error_m * error_m
        self.saturated_s += 1e-3 * saturated
        self._load += load_n
        self._count += 1
        self._touched |= contact
        deviation = 1e3 * float(error_m @ error_m) ** 0.5
        self.worst_deviation_mm = max(self.worst_deviation_mm, deviation)
        if self._count == WINDOW:
            mean, span = self._load / WINDOW, 1e-3 * WINDOW
            size = float(mean @ mean) ** 0.5
            self.force_squared_n2_s += span * mean * mean
            self.worst_load_n = max(self.worst_load_n, size)
            if self._touched:
                self.contact_s += span
                self.deviation_mm_s += span * deviation
                self.load_n_s += span * size
            self._load, self._count, self._touched = np.zeros(3), 0, False

    @property
    def load_n(self) -> float:
        """Mean magnitude of the load over the time in contact, N."""
        return self.load_n_s / max(self.contact_s, 1e-9)

    @property
    def deviation_mm(self) -> float:
        """Mean path error over the time in contact, mm."""
        return self.deviation_mm_s / max(self.contact_s, 1e-9)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, ready for JSON."""
        named = {k: v for k, v in asdict(self).items() if not k.startswith("_")}
        plain = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in named.items()}
        return {**plain, "load_n": self.load_n, "deviation_mm": self.deviation_mm}
