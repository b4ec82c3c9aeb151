"""The cutting force, by following the surface that the teeth leave, angle by angle.

Around the saw's centre the material begins at radius R + rim(theta). In one millisecond the centre moves by
(dx, dz), so the material comes nearer by dx sin(theta) - dz cos(theta); a tooth of radius R + r_j that sweeps
over theta finds a chip h = r_j - rim(theta), loads the saw with

    dFt = b (k_te + k_tc h),   dFr = b (k_re + k_rc h),   dFa likewise        while h > 0,

and leaves rim = r_j. Nothing here knows a chip formula: feed per tooth, carry-over of idle teeth, plunging,
regeneration of vibration, entry and exit follow from the surface. theta from the normal into the sheet
toward the feed; process axes x feed, y into the sheet, z saw axis; forces on the tool

    Fx = -Ft cos - Fr sin,   Fy = Ft sin - Fr cos,   Fz = -Fa.

Assumes a sheet's top and ends are planes, arcs up to 0.75 rad (6.7 mm deep), that the surface's slope along
theta is small against 1, and the spindle's turn in a step below the smallest tooth gap.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LOW_RAD, HIGH_RAD = -0.2, 0.75
FAR_M = 1e-3
"""Where no material is near, the surface counts as this far beyond the radius."""


@dataclass(frozen=True)
class Blade:
    """The teeth. Fields: `radius_m`, `kerf_m`; `lag_rad` [N] of each tooth behind tooth 0, increasing;
    `reach_m` [N] deviation of each tooth's radius."""

    radius_m: float
    kerf_m: float
    lag_rad: Array
    reach_m: Array


@dataclass(frozen=True)
class Sheet:
    """Where the material is along the path: `start_m` to `end_m`, from its top down by `thickness_m`."""

    start_m: float
    end_m: float
    thickness_m: float


@dataclass(frozen=True)
class Sweep:
    """One step's outcome. Fields: `force_n` [slots, 3] process axes, means over equal parts of the step;
    `removed_m3` chip volume; `contact` whether a tooth touched; `arm_rad` mean angle of the force, 0 without.
    """

    force_n: Array
    removed_m3: float
    contact: bool
    arm_rad: float


class Saw:
    """A turning saw and the surface around it.

    Arguments: blade, sheet; `speed_rev_s` of the spindle; `step_s`; `samples` angles that a tooth is followed
    at in a step; `slots` parts of a step with a force of their own; `angle_rad` of tooth 0 at the start.

    Raises:
        ValueError: the spindle turns by more than the smallest tooth gap in a step.
    """

    def __init__(
        self,
        blade: Blade,
        sheet: Sheet,
        speed_rev_s: float,
        *,
        step_s: float = 1e-3,
        samples: int = 64,
        slots: int = 8,
        angle_rad: float = 0.0,
    ):
        self.blade, self.sheet, self.slots = blade, sheet, slots
        self.turn_rad = 2.0 * np.pi * speed_rev_s * step_s
        gap = np.diff(blade.lag_rad, append=blade.lag_rad[0] + 2.0 * np.pi)
        if self.turn_rad >= gap.min():
            raise ValueError(
                f"the spindle turns {self.turn_rad:.3g} rad in a step, and the smallest tooth gap is "
                f"{gap.min():.3g} rad; expected less: lower the speed, or use fewer teeth"
            )
        self.angle_rad = angle_rad
        self.bin_rad = self.turn_rad / samples
        self._low = LOW_RAD + self.bin_rad * np.arange(int((HIGH_RAD - LOW_RAD) / self.bin_rad))
        middle = self._low + 0.5 * self.bin_rad
        self._sine, self._cosine = np.sin(middle), np.cos(middle)
        self._ahead = self._sine > 1e-3
        self._over = 1.0 / np.cos(self._low)  # lower edges: the bin that the sheet's top crosses is part full
        self.rim_m = np.full(middle.size, FAR_M)
        self._fresh = self._ahead.copy()  # bins whose material is still the sheet's near end
        self._placed = False

    def step(
        self, shift_m: tuple[float, float], along_m: float, depth_m: float, chip_n_m2: Array, edge_n_m: Array
    ) -> Sweep:
        """Turns the spindle by one step while the centre moves.

        Arguments: `shift_m` of the centre in the step, along the feed and up; `along_m` path position and
        `depth_m` of the saw's lowest point below the sheet's top at the step's start; constants [3].
        """
        radius = self.blade.radius_m
        force = np.zeros((self.slots, 3))
        if self.sheet.start_m - along_m > radius or depth_m < -FAR_M:  # all air: nothing to follow
            self.angle_rad, self._placed = (self.angle_rad + self.turn_rad) % (2.0 * np.pi), False
            return Sweep(force, 0.0, False, 0.0)
        nearer = shift_m[0] * self._sine - shift_m[1] * self._cosine
        start, self.angle_rad = self.angle_rad, (self.angle_rad + self.turn_rad) % (2.0 * np.pi)
        least = self._free(along_m, depth_m)
        if not self._placed:
            self.rim_m, self._placed = np.minimum(least, FAR_M), True
        if along_m >= self.sheet.start_m:
            self._fresh[:] = False
        self.rim_m = np.where(self._fresh, least, self.rim_m)
        after = self.rim_m - nearer
        removed, moment, weight = 0.0, 0.0, 0.0
        if depth_m > 0.0:
            leave = float(np.arccos(1.0 - min(depth_m / radius, 0.99)))
            angles = (start - self.blade.lag_rad + np.pi) % (2.0 * np.pi) - np.pi
            inside = self._inside(along_m)
            near = np.nonzero((angles + self.turn_rad > LOW_RAD) & (angles < min(leave, HIGH_RAD)))[0]
            for tooth in near:
                reach = self.blade.reach_m[tooth]
                cut = self._tooth(angles[tooth], reach, nearer, least, after, leave, inside)
                if cut is None:
                    continue
                part, chip, share, slot = cut
                touch = share * self.blade.kerf_m * self.bin_rad / self.turn_rad * self.slots
                ft, fr, fa = touch * (edge_n_m[:, None] + chip_n_m2[:, None] * chip)
                sine, cosine = self._sine[part], self._cosine[part]
                for axis, each in enumerate((-ft * cosine - fr * sine, ft * sine - fr * cosine, -fa)):
                    force[:, axis] += np.bincount(slot, each, self.slots)
                removed += float(share @ chip)
                moment += float(touch @ self._low[part])
                weight += float(touch.sum())
        self.rim_m = np.maximum(np.minimum(after, FAR_M), least)
        volume = removed * self.bin_rad * radius * self.blade.kerf_m
        return Sweep(force, volume, weight > 0.0, moment / weight if weight > 0.0 else 0.0)

    def _free(self, along_m: float, depth_m: float) -> Array:
        """[bins] the least rim: the sheet's untouched top, and its near end."""
        radius = self.blade.radius_m
        least = (radius - depth_m) * self._over - radius
        gap = self.sheet.start_m - along_m
        if gap > 0.0:
            least[self._ahead] = np.maximum(least[self._ahead], gap / self._sine[self._ahead] - radius)
            least[~self._ahead] = float(self.blade.reach_m.max())  # behind the centre all has been cut
        return least

    def _inside(self, along_m: float) -> NDArray[np.bool_] | None:
        """[bins] whether the rim lies between the sheet's ends; None where all of it does."""
        radius, sheet = self.blade.radius_m, self.sheet
        if along_m > sheet.start_m + radius and along_m < sheet.end_m - radius:
            return None
        across = along_m + radius * self._sine
        return (across >= sheet.start_m) & (across <= sheet.end_m)

    def _tooth(
        self,
        angle: float,
        reach: float,
        nearer: Array,
        least: Array,
        after: Array,
        leave: float,
        inside: NDArray[np.bool_] | None,
    ) -> tuple[slice, Array, Array, NDArray[np.intp]] | None:
        """Chips [m] and shares of contact in the bins that one tooth sweeps; `after` is cut where it passed.
        A bin's rim changes once the tooth has left it, so that a bin may be swept in two steps."""
        end = angle + self.turn_rad
        first = max(int((angle - LOW_RAD) // self.bin_rad), 0)
        last = min(int((min(end, leave) - LOW_RAD) // self.bin_rad), self._low.size - 1)
        if last < first:
            return None
        part = slice(first, last + 1)
        low = self._low[part]
        high = low + self.bin_rad
        when = _share((low + 0.5 * self.bin_rad - angle) / self.turn_rad)
        chip = reach - np.maximum(self.rim_m[part] - when * nearer[part], least[part])
        share = _share((leave - low) / self.bin_rad)
        share *= _share((np.minimum(high, end) - np.maximum(low, angle)) / self.bin_rad)
        if inside is not None:
            share *= inside[part]
        cuts = chip > 0.0
        passed = cuts & (high <= end)
        after[part] = np.where(passed, reach - (1.0 - when) * nearer[part], after[part])
        self._fresh[part] &= ~(passed & (share > 0.0))
        share, chip = share * cuts, np.maximum(chip, 0.0)
        return part, chip, share, np.minimum((when * self.slots).astype(np.intp), self.slots - 1)


def _share(value: NDArray[Any]) -> NDArray[Any]:
    return np.minimum(np.maximum(value, 0.0), 1.0)
