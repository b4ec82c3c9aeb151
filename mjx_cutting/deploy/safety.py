"""The safety state machine: what may move, how fast, and when it must stop.

    IDLE      --arm-->        ARMED
    ARMED     --start-->      RUNNING       --stop, disarm, silence--> IDLE
    RUNNING   --any reason--> SAFE_STOP
    SAFE_STOP --standstill--> IDLE where asked for or finished, else FAULT
    FAULT     --arm-->        ARMED         --disarm--> IDLE
    any but IDLE --robot's own fault--> FAULT

RUNNING is entered from ARMED alone, ARMED by an explicit arm alone; so a fault is left only by re-arming (or
disarming). Set-points are this machine's: it ramps up from standstill (feed adjustment -1, depth at its low
end) to the policy's initial ones, lets the policy move them within range and rate, and ramps back to
standstill in every other mode. Times are monotonic nanoseconds that the caller passes in.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.protocol import Cause, Mode, Robot, State

# isort: split
import numpy as np

STANDSTILL_FEED = -1.0
HARMLESS = (Cause.REQUESTED, Cause.FINISHED, Cause.SHUTDOWN)
"""Causes of a stop that end in IDLE."""

FEED, DEPTH = 3, 4


@dataclass(frozen=True)
class Limits:
    """When to stop, beyond the range and rate of each set-point that the policy's file names.

    Arguments: force_n, magnitude of the force, passed by force_samples samples in a row, at which to stop;
    deviation_m, path error at which to stop; fresh_s, age of the newest STATE up to which the policy acts on
    it; hold_s, age up to which the set-points are then held, before the ramp to standstill; overrun_s,
    lateness of the server itself at which to stop.

    Raises:
        ValueError: a number out of its range.
    """

    force_n: float = 250.0
    force_samples: int = 3
    deviation_m: float = 0.15
    fresh_s: float = 0.02
    hold_s: float = 0.1
    overrun_s: float = 0.1

    def __post_init__(self) -> None:
        for name in ("force_n", "force_samples", "deviation_m", "fresh_s", "hold_s", "overrun_s"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"got {name} = {getattr(self, name)}; expected a finite number above 0")
        if not self.fresh_s <= self.hold_s <= 1.0:
            raise ValueError(
                f"got fresh_s = {self.fresh_s} and hold_s = {self.hold_s}; expected fresh_s <= hold_s <= 1 s"
            )


PLAUSIBLE = State(
    flags=31, command_sequence=2**32 - 1, path_error_m=(1.0,) * 3, velocity_m_s=(2.0,) * 3,
    position_m=(5.0,) * 3, force_n=(5000.0,) * 3, speed_along_m_s=2.0, path_m=100.0, cut_length_m=1e6,
    spindle_angle_rad=1e12, spindle_speed_rev_s=2000.0,
)  # fmt: skip
"""Largest magnitude that each number of a STATE may have; a packet beyond is no measurement."""


def plausible(state: State) -> bool:
    """Whether every number of a STATE lies where a measurement can."""
    if state.flags > PLAUSIBLE.flags:
        return False
    for value, most in zip(state[2:6], PLAUSIBLE[2:6], strict=True):
        x, y, z = value
        if not (abs(x) <= most[0] and abs(y) <= most[1] and abs(z) <= most[2]):
            return False
    return all(abs(value) <= most for value, most in zip(state[6:], PLAUSIBLE[6:], strict=True))


class Safety:
    """The state machine and the set-points.

    Arguments:
        artefact: the policy, whose limits and rates hold.
        limits: when to stop.
        log: called with one line for every transition and every refusal.
    """

    def __init__(self, artefact: Artefact, limits: Limits, log: Callable[[str], None]):
        self.limits, self._log = limits, log
        self.mode, self.cause = Mode.IDLE, Cause.NONE
        self._logarithmic = np.asarray(artefact.action_log, bool)
        self._low = self._inner(artefact.action_low)
        self._high = self._inner(artefact.action_high)
        self._step = np.asarray(artefact.action_rate_per_s, float) * artefact.policy_period_s
        self._initial = self._inner(artefact.action_initial)
        self._standstill = self._initial.copy()
        self._standstill[FEED] = STANDSTILL_FEED
        self._standstill[DEPTH] = self._low[DEPTH]
        self._now = self._standstill.copy()
        self._running_up = False
        self._over = 0
        self._robot = 0
        self._heavy = False
        self._refused: tuple[Mode, Cause] | None = None

    # -- what the controller asks for

    def arm(self, age_s: float) -> None:
        """IDLE or FAULT to ARMED, where the robot is ready, unloaded and heard of `age_s` ago at most."""
        if self.mode not in (Mode.IDLE, Mode.FAULT):
            return
        cause = Cause.NONE
        if age_s > self.limits.hold_s:
            cause = Cause.STALE
        elif self._robot & Robot.FAULT or not self._robot & Robot.READY:
            cause = Cause.ROBOT
        elif self._heavy:
            cause = Cause.FORCE
        if cause is Cause.NONE:
            self._go(Mode.ARMED, Cause.NONE)
        elif self._refused != (self.mode, cause):
            self._refused = self.mode, cause
            self._log(f"arming refused in {self.mode.name}: {cause.name}")

    def start(self) -> None:
        """ARMED to RUNNING; nothing in any other mode."""
        if self.mode is Mode.ARMED:
            self._running_up, self._over = True, 0
            self._now = self._standstill.copy()
            self._go(Mode.RUNNING, Cause.NONE)

    def stop(self, cause: Cause = Cause.REQUESTED) -> None:
        """Out of RUNNING by the ramp; out of ARMED at once. A worse cause replaces that of a ramp."""
        if self.mode is Mode.RUNNING:
            self._go(Mode.SAFE_STOP, cause)
        elif self.mode is Mode.SAFE_STOP:
            if self.cause in HARMLESS and cause not in HARMLESS:
                self._go(Mode.SAFE_STOP, cause)
        elif self.mode is Mode.ARMED:
            self._go(Mode.IDLE if cause in HARMLESS or cause is Cause.STALE else Mode.FAULT, cause)

    def disarm(self) -> None:
        """ARMED or FAULT to IDLE; nothing while the robot moves."""
        if self.mode in (Mode.ARMED, Mode.FAULT):
            self._go(Mode.IDLE, Cause.NONE)

    # -- what is measured

    def sample(self, state: State) -> None:
        """Looks at one sample of the robot and the force."""
        limits = self.limits
        self._robot = state.flags
        x, y, z = state.force_n
        self._heavy = x * x + y * y + z * z > limits.force_n**2
        self._over = self._over + 1 if self._heavy else 0
        if self.mode in (Mode.IDLE, Mode.FAULT):
            return
        if state.flags & Robot.FAULT:
            self._go(Mode.FAULT, Cause.ROBOT)
            return
        if not state.flags & Robot.READY:
            self.stop(Cause.ROBOT)
        if self._over >= limits.force_samples:
            self.stop(Cause.FORCE)
        x, y, z = state.path_error_m
        if x * x + y * y + z * z > limits.deviation_m**2:
            self.stop(Cause.DEVIATION)
        if state.flags & Robot.FINISHED and self.mode is Mode.RUNNING:
            self.stop(Cause.FINISHED)

    def watch(self, age_s: float, late_s: float = 0.0) -> bool:
        """Whether the newest STATE, `age_s` old, may be acted on; stops where it or this process is late."""
        if self.mode in (Mode.ARMED, Mode.RUNNING, Mode.SAFE_STOP):
            if age_s > self.limits.hold_s:
                self.stop(Cause.STALE)
            elif late_s > self.limits.overrun_s:
                self.stop(Cause.OVERRUN)
        return self.mode is Mode.RUNNING and age_s <= self.limits.fresh_s

    # -- set-points

    @property
    def policy_acts(self) -> bool:
        """Whether the policy moves the set-points: RUNNING, and the run-up is over."""
        return self.mode is Mode.RUNNING and not self._running_up

    @property
    def set_point(self) -> np.ndarray:
        """[5] the present set-points, in the policy's units."""
        return np.where(self._logarithmic, np.exp(np.where(self._logarithmic, self._now, 0.0)), self._now)

    def advance(self, wish: np.ndarray | None) -> None:
        """Moves the set-points by one policy period.

        Arguments: wish, [5] the policy's next set-points, in its units; None to hold. It is followed while
        the policy acts, and where it leaves its range or rate, the cut is stopped.
        """
        if self.mode is not Mode.RUNNING:
            self._ramp()
        elif self._running_up:
            self._now = self._toward(self._initial)
            self._running_up = bool(np.any(np.abs(self._now - self._initial) > 1e-9))
        elif wish is not None:
            with np.errstate(invalid="ignore", divide="ignore"):
                inner = self._inner(wish)
            cause = self._fault_of(inner)
            if cause is Cause.NONE:
                self._now = np.clip(inner, self._low, self._high)
            else:
                self.stop(cause)
                self._ramp()

    def _fault_of(self, inner: np.ndarray) -> Cause:
        if not np.all(np.isfinite(inner)):
            return Cause.POLICY
        span = 1e-6 * (self._high - self._low)
        inside = np.all((inner >= self._low - span) & (inner <= self._high + span))
        slow = np.all(np.abs(inner - self._now) <= self._step + span)
        return Cause.NONE if inside and slow else Cause.RANGE

    def _ramp(self) -> None:
        target = self._standstill.copy()
        if self.mode is Mode.SAFE_STOP:
            target[:FEED] = self._now[:FEED]  # stiffness is kept while the tool leaves the cut
        self._now = self._toward(target)
        still = np.abs(self._now - self._standstill)[[FEED, DEPTH]]
        if self.mode is Mode.SAFE_STOP and np.all(still < 1e-9):
            self._go(Mode.IDLE if self.cause in HARMLESS else Mode.FAULT, self.cause)

    def _toward(self, target: np.ndarray) -> np.ndarray:
        moved: np.ndarray = self._now + np.clip(target - self._now, -self._step, self._step)
        return moved

    def _inner(self, value: object) -> np.ndarray:
        array = np.asarray(value, float)
        return np.where(self._logarithmic, np.log(np.where(self._logarithmic, array, 1.0)), array)

    def _go(self, mode: Mode, cause: Cause) -> None:
        told = "" if cause is Cause.NONE else f" ({cause.name})"
        self._log(f"{self.mode.name} -> {mode.name}{told}")
        self.mode, self.cause, self._refused = mode, cause, None
