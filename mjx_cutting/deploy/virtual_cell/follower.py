"""The controller's own set-points: interpolated each millisecond, and brought to rest without the server.

A COMMAND's set-points are reached over its period, the gains on the logarithm. The reference walks along the
path with v_n (1 + feed adjustment), at the depth asked for. Where the server falls silent for longer than
`hold_us`, where it leaves RUNNING, or at the end of the path, the controller stops by itself: the feed ramps
to rest, then the tool leaves the cut upward. During SAFE_STOP the server's own ramp is followed first.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.deploy.protocol import Command, Mode, Welcome

Array = NDArray[np.float64]
FEED_RATE_S = 2.0
RETRACT_M_S = 0.02
CLEARANCE_M = 0.02
REST = -1.0
"""Feed adjustment at rest."""


class Phase(enum.Enum):
    """What the controller is doing."""

    HOLDING = "holding"
    CUTTING = "cutting"
    STOPPING = "stopping"
    RETRACTING = "retracting"
    CLEAR = "clear"


@dataclass(frozen=True)
class Goal:
    """Where the saw's lowest point shall be. Fields: `path_m` along the path, `depth_m` below the nominal
    surface (negative: above), their rates, and the position gains [3], s^-2."""

    path_m: float
    depth_m: float
    feed_m_s: float
    sink_m_s: float
    gain_s2: Array


class Follower:
    """Interpolates, watches the clock, and comes to rest. Argument: `length_m` of the path.

    Fields: `phase`; `why` it stopped ("", "finished", "silence", or the server's cause); `ignored` commands
    that were out of range.
    """

    def __init__(self, length_m: float):
        self.length_m = length_m
        self.welcome: Welcome | None = None
        self.reset()

    def reset(self) -> None:
        """At the start of the path, waiting."""
        self.phase, self.why, self.ignored, self.mode = Phase.HOLDING, "", 0, Mode.IDLE
        self.path_m, self._hold_ns, self._heard_ns = 0.0, 0, 0
        self._now = np.array([*np.log([1000.0] * 3), REST, 0.0])
        self._step, self._left = np.zeros(5), 0
        if self.welcome is not None:
            self.welcomed(self.welcome)

    def welcomed(self, welcome: Welcome) -> None:
        """Takes over the limits; the initial gains hold the tool until the cut."""
        self.welcome = welcome
        if self.phase is Phase.HOLDING:
            self._now[:3] = np.log(welcome.initial[:3])

    def command(self, command: Command, now_ns: int) -> bool:
        """Takes a COMMAND that the endpoint found valid; False where its set-points are out of range."""
        welcome = self.welcome
        if welcome is None or not _inside(command.set_point, welcome):
            self.ignored += 1
            return False
        self.mode, self._hold_ns, self._heard_ns = command.mode, 1000 * command.hold_us, now_ns
        if self.phase is Phase.HOLDING and self.mode is Mode.RUNNING:
            self.phase = Phase.CUTTING
        if self.phase is not Phase.CUTTING:
            return True
        if self.mode in (Mode.RUNNING, Mode.SAFE_STOP):
            target = np.array([*np.log(command.set_point[:3]), *command.set_point[3:]])
            self._left = max(1, command.period_us // 1000)
            self._step = (target - self._now) / self._left
        if self.mode is Mode.SAFE_STOP:
            self.why = command.cause.name.lower()
            if command.set_point[3] <= REST + 1e-6:
                self._stop(self.why)
        elif self.mode is not Mode.RUNNING:
            self._stop(command.cause.name.lower())
        return True

    def tick(self, now_ns: int) -> Goal:
        """One millisecond."""
        if self.phase is Phase.CUTTING and now_ns - self._heard_ns > self._hold_ns:
            self._stop("silence")
        nominal = self.welcome.nominal_feed_m_s if self.welcome else 0.0
        depth = self._now[4]
        if self.phase is Phase.CUTTING:
            if self._left > 0:
                self._now += self._step
                self._left -= 1
        elif self.phase is Phase.STOPPING:
            self._now[3] = max(REST, self._now[3] - 1e-3 * FEED_RATE_S)
            if self._now[3] <= REST:
                self.phase = Phase.RETRACTING
        elif self.phase is Phase.RETRACTING:
            self._now[4] = max(-CLEARANCE_M, self._now[4] - 1e-3 * RETRACT_M_S)
            if self._now[4] <= -CLEARANCE_M:
                self.phase = Phase.CLEAR
        feed = nominal * (1.0 + self._now[3])
        self.path_m = min(self.path_m + 1e-3 * feed, self.length_m)
        if self.phase is Phase.CUTTING and self.path_m >= self.length_m:
            self.why = "finished"
        if self.path_m >= self.length_m:
            feed = 0.0
        return Goal(self.path_m, self._now[4], feed, (self._now[4] - depth) * 1e3, np.exp(self._now[:3]))

    def fault(self, why: str) -> None:
        """Stops for a reason of the cell's own."""
        if self.phase in (Phase.HOLDING, Phase.CUTTING):
            self._stop(why)

    @property
    def finished(self) -> bool:
        """Whether the end of the path was reached while the policy was in command."""
        return self.why == "finished"

    def _stop(self, why: str) -> None:
        self.phase, self.why, self._left = Phase.STOPPING, self.why or why, 0
        if self.welcome is not None:  # soft gains would let the tool hang in the cut
            self._now[:3] = np.maximum(self._now[:3], np.log(self.welcome.initial[:3]))


def _inside(set_point: tuple[float, ...], welcome: Welcome) -> bool:
    low = (*welcome.low[:3], REST, min(0.0, welcome.low[4]))
    return all(
        below - 1e-6 * (above - below) <= value <= above + 1e-6 * (above - below)
        for below, value, above in zip(low, set_point, welcome.high, strict=True)
    )
