"""The force sensor: what becomes of the load between the transducer and the sample at 500 Hz.

The load comes in `slots` parts a millisecond (8 kHz). It passes the transducer's resonance and an undeclared
low-pass (hidden effects), then the declared one (Butterworth of order 4 at 120 Hz: what a sensor sampled at
500 Hz beside teeth that pass at 380 Hz needs), and every second millisecond one sample is taken, with drift,
noise, and clipping at the range. The filters are linear, so a millisecond of them is two matrix products.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from mjx_cutting.deploy.virtual_cell.hidden import Drift, SensorLowpass, SensorResonance

Array = NDArray[np.float64]
DECLARED_HZ, DECLARED_ORDER = 120.0, 4
NOISE_N = (0.10, 0.10, 0.18)
RANGE_N = (500.0, 500.0, 900.0)


class Sensor:
    """The filters with their memory. Arguments: `slots` inputs a millisecond; the effects; `seed`."""

    def __init__(
        self, slots: int, lowpass: SensorLowpass, resonance: SensorResonance, drift: Drift, seed: int = 0
    ):
        rate = 1000.0 * slots
        parts = []
        if resonance.frequency_hz > 0.0:
            natural = 2.0 * np.pi * resonance.frequency_hz
            bilinear = signal.bilinear(
                [natural**2], [1.0, 2.0 * resonance.damping * natural, natural**2], fs=rate
            )
            parts.append(signal.tf2ss(*bilinear))
        if lowpass.hz > 0.0:
            for row in signal.butter(lowpass.order, lowpass.hz, fs=rate, output="sos"):
                parts.append(signal.tf2ss(row[:3], row[3:]))
        for row in signal.butter(DECLARED_ORDER, DECLARED_HZ, fs=rate, output="sos"):
            parts.append(signal.tf2ss(row[:3], row[3:]))
        a, b, c, d = parts[0]
        for _, (a2, b2, c2, d2) in pairwise(parts):
            a = np.block([[a, np.zeros((len(a), len(a2)))], [b2 @ c, a2]])
            b, c, d = np.vstack([b, b2 @ d]), np.hstack([d2 @ c, c2]), d2 @ d
        powers = [np.linalg.matrix_power(a, k) for k in range(slots + 1)]
        self._keep = powers[slots]
        self._take = np.hstack([powers[slots - 1 - k] @ b for k in range(slots)])
        # the output at the last slot, from the state before the block
        self._out_state = c @ powers[slots - 1]
        self._out_load = np.hstack([*(c @ powers[slots - 2 - k] @ b for k in range(slots - 1)), d])
        self._drift = np.asarray(drift.final_n), drift.tau_s
        self._noise = np.random.default_rng(seed)
        self.reset(0.0)

    def reset(self, clock_s: float) -> None:
        """Filters at rest; zeroed at this time of the session."""
        self._state = np.zeros((len(self._keep), 3))
        self._zeroed = self._bias(clock_s)
        self.filtered_n = np.zeros(3)

    def feed(self, load_n: Array) -> None:
        """Passes one millisecond of load [slots, 3] on."""
        self.filtered_n = (self._out_state @ self._state + self._out_load @ load_n)[0]
        self._state = self._keep @ self._state + self._take @ load_n

    def sample(self, clock_s: float) -> Array:
        """[3] one sample, N."""
        value = self.filtered_n + self._bias(clock_s) - self._zeroed
        value += np.asarray(NOISE_N) * self._noise.standard_normal(3)
        return np.clip(value, np.negative(RANGE_N), RANGE_N)

    def _bias(self, clock_s: float) -> Array:
        final, tau = self._drift
        return final * -np.expm1(-clock_s / tau)
