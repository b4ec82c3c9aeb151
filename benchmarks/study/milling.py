"""The force of a mill or saw in time, tooth pass after tooth pass.

Every pass of every tooth is followed over its arc on equal cells of angle that begin exactly at entry and end
exactly at exit; the surface a pass finds is the largest reach of all passes before it at that angle. The
impulse of each cell is laid onto a fine grid of time (linear split, droop of that split undone), so that no
gate falls on a grid. A helix is a moving average over the time its edge takes to pass.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

Array = NDArray[np.float64]
Params = dict[str, Any]
REFERENCE_CHIP_M = 5e-5
_LEAST_CELLS = 64


@dataclass
class Milling:
    """One trial to be cut: geometry, constants [3], speed, feed, effects by name, and how it goes in time.

    travel: position along the path at a time, m (vectorised); wander: lead of the spindle angle over even
    turning, rad, at an angle; stuck: by how much a pass reaches further than its tooth alone, m, by its
    number.
    """

    teeth: int
    radius_m: float
    helix_rad: float
    milling: str
    depth_m: float
    width_m: float
    speed_rev_s: float
    feed_m_s: float
    phase_rad: float
    chip_n_m2: Array
    edge_n_m: Array
    length_before_m: float = 0.0
    effects: dict[str, Params] = field(default_factory=dict)
    travel: Callable[[Array], Array] | None = None
    wander: Callable[[Array], Array] | None = None
    stuck: Callable[[NDArray[np.integer]], Array] | None = None

    def arc(self) -> tuple[float, float]:
        """Angles at which a tooth enters and leaves, rad."""
        if self.milling == "slot":
            return 0.0, np.pi
        swept = float(np.arccos(np.clip(1.0 - self.depth_m / self.radius_m, -1.0, 1.0)))
        return (0.0, swept) if self.milling == "conventional" else (np.pi - swept, np.pi)

    def position(self, time: Array) -> Array:
        """Position along the path, m."""
        return self.feed_m_s * time if self.travel is None else self.travel(time)

    def time_at(self, angle: Array) -> Array:
        """When the spindle is at an angle (that of tooth 0), s."""
        even = angle - self.phase_rad
        ripple = self.effects.get("torque_ripple")
        if ripple:
            p = ripple["order"]
            even = even - ripple["amplitude"] / p * np.sin(p * angle + ripple["phase_rad"])
        if self.wander is not None:
            even = even - self.wander(angle)
        return even / (2.0 * np.pi * self.speed_rev_s)

    def lags(self) -> Array:
        """[N] angle by which each tooth comes after tooth 0."""
        gaps = np.full(self.teeth, 2.0 * np.pi / self.teeth)
        if "unequal_pitch" in self.effects:
            gaps = gaps + np.asarray(self.effects["unequal_pitch"]["pitch_error_rad"])
        return np.cumsum(gaps) - gaps[0]

    def reaches(self) -> Array:
        """[N] radius of each tooth over the mean, m."""
        runout = self.effects.get("radial_runout")
        if not runout:
            return np.zeros(self.teeth)
        spread = 2.0 * np.pi * np.arange(self.teeth) / self.teeth
        return runout["offset_m"] * np.cos(runout["angle_rad"] - spread)


def shear(chip: Array, effects: dict[str, Params]) -> Array:
    """[3, ...] the thickness that the chip constants multiply, m, of chips [...] >= 0, by direction of force
    (tangential, radial, axial)."""
    made = chip
    if "ploughing" in effects:
        p = effects["ploughing"]
        least = p["minimum_chip_m"]
        ploughed = -least * np.expm1(-chip / least) if p.get("gradual") else np.minimum(chip, least)
        made = chip + (p["ratio"] - 1.0) * ploughed
    if "size_effect" in effects:
        p = effects["size_effect"]
        thick = np.maximum(chip, 1e-12) / REFERENCE_CHIP_M
        times = (1.0, p.get("radial_ratio", 1.0), p.get("axial_ratio", 1.0))
        return np.stack([made * thick ** (-p["exponent"] * each) for each in times])
    return np.broadcast_to(made, (3, *made.shape))


def along(
    position: Array, effects: dict[str, Params], ahead: Array | float = 0.0
) -> tuple[Array | float, Array | float]:
    """Factors of the chip part and of the edge part by position of the tool, a tooth being `ahead` of it."""
    chip: Array | float = 1.0
    edge: Array | float = 1.0
    if "material_periodicity" in effects:
        p = effects["material_periodicity"]
        met = position + p.get("tooth_place", 0.0) * ahead
        chip = 1.0 + p["amplitude"] * np.cos(2.0 * np.pi * met / p["wavelength_m"] + p["phase_rad"])
    if "layered_material" in effects:
        p = effects["layered_material"]
        inside = (position >= p["start_m"]) & (position < p["start_m"] + p["length_m"])
        layer = 1.0 + p["change"] * inside
        chip, edge = chip * layer, edge * layer
    return chip, edge


def passes(cut: Milling, begin_s: float, end_s: float, cells: int) -> tuple[Array, Array, Array, Array]:
    """Every tooth pass between two times.

    Returns times [P, n] of the cell centres, the impulse per cell [P, n, 3] on the tool (N s, process axes),
    the tangential impulse [P, n], and the cells' duration [P, n] or [].
    """
    entry, exit_ = cut.arc()
    step = (exit_ - entry) / cells
    angle = entry + step * (np.arange(cells) + 0.5)
    sine, cosine = np.sin(angle), np.cos(angle)
    turn = 2.0 * np.pi * cut.speed_rev_s
    first = cut.teeth * int(np.floor((turn * begin_s + cut.phase_rad) / (2.0 * np.pi)) - 2)
    last = cut.teeth * int(np.ceil((turn * end_s + cut.phase_rad) / (2.0 * np.pi)) + 2)
    index = np.arange(first, last)
    tooth = index % cut.teeth
    spindle = cut.lags()[tooth] + 2.0 * np.pi * (index // cut.teeth)
    time = cut.time_at(spindle[:, None] + angle)
    broken = cut.effects.get("broken_tooth")
    contact, thick = _chips(cut, time, index, sine, None)
    if broken:
        gone = float(broken["share"])
        lame, fat = _chips(cut, time, index, sine, int(broken["tooth"]))
        parts = [(1.0 - gone, contact, thick), (gone, lame, fat)]
    else:
        parts = [(1.0, contact, thick)]
    place = cut.position(time)
    chip_gain, edge_gain = along(place, cut.effects, cut.radius_m * sine)
    if "entry_exit" in cut.effects:
        inside = _inside_sheet(cut, place, sine)
        chip_gain, edge_gain = chip_gain * inside, edge_gain * inside
    rubbing: Array = np.zeros(time.shape)
    sheared: Array = np.zeros((3, *time.shape))
    for share, touch, chip in parts:
        made = shear(chip, cut.effects)
        if "clogging" in cut.effects:
            p = cut.effects["clogging"]
            area = np.cumsum(chip, axis=1) * cut.radius_m * step
            made = made * (1.0 + p["gain"] * np.maximum(area / p["capacity_m2"] - 1.0, 0.0))
        sheared += share * touch * made
        rubbing += share * touch
    duration = cut.width_m * step / turn
    sheared *= chip_gain * duration
    rubbing *= edge_gain * duration
    local = [k * part + e * rubbing for k, part, e in zip(cut.chip_n_m2, sheared, cut.edge_n_m, strict=True)]
    if "flank_wear" in cut.effects:
        p = cut.effects["flank_wear"]
        land = rubbing * (p["rate"] * (cut.length_before_m + np.maximum(place, 0.0)))
        local = [part + kappa * land for part, kappa in zip(local, p["kappa_n_m2"], strict=True)]
    tangential, radial, axial = local
    force = np.stack([-tangential * cosine - radial * sine, tangential * sine - radial * cosine, -axial])
    if "torque_ripple" in cut.effects:
        p = cut.effects["torque_ripple"]
        slow = 1.0 - p["amplitude"] * np.cos(p["order"] * (spindle[:, None] + angle) + p["phase_rad"])
        force, tangential = force * slow, tangential * slow
    return time, force, tangential, spindle


def _chips(
    cut: Milling, time: Array, index: NDArray[np.integer], sine: Array, absent: int | None
) -> tuple[Array, Array]:
    """Contact (0 to 1) and thickness [P, n] of every pass by its number; a tooth may be absent."""
    tooth = index % cut.teeth
    reach = cut.reaches()[tooth]
    if cut.stuck is not None:
        reach = reach + cut.stuck(index)
    tip = cut.position(time) * sine + reach[:, None]
    if absent is not None:
        tip = np.where((tooth == absent)[:, None], -np.inf, tip)
    surface = np.maximum.accumulate(tip, axis=0)
    bare = np.empty_like(tip)
    bare[0] = 0.0
    bare[1:] = tip[1:] - surface[:-1]
    if absent is None and not reach.any():
        return np.ones((1, 1)), np.maximum(bare, 0.0)
    bare = np.where(np.isfinite(bare), bare, -1.0)
    slope = np.abs(np.gradient(bare, axis=1))
    contact = np.clip(bare / np.maximum(slope, 1e-15) + 0.5, 0.0, 1.0)
    return contact, np.maximum(bare, 0.0)


def _inside_sheet(cut: Milling, place: Array, sine: Array) -> Array:
    """Share of the cell that lies between the ends of the sheet [P, n]."""
    p = cut.effects["entry_exit"]
    a, r = cut.depth_m, cut.radius_m
    reach = r if cut.milling == "slot" or a > r else np.sqrt(2.0 * r * a - a * a)
    beyond = place - p["start_m"] - reach + r * sine
    cell = np.maximum(np.abs(np.gradient(beyond, axis=1)), 1e-15)
    begun, over = (np.clip(way / cell + 0.5, 0.0, 1.0) for way in (beyond, beyond - p["length_m"]))
    return begun - over


def mean_load(cut: Milling) -> tuple[Array, float]:
    """Mean force [3] N and torque N m over a steady turn."""
    steady = Milling(**{**cut.__dict__, "travel": None, "wander": None, "stuck": None, "phase_rad": 0.0})
    local = ("entry_exit", "material_periodicity", "layered_material", "torque_ripple")
    steady.effects = {name: p for name, p in cut.effects.items() if name not in local}
    _, force, tangential, _ = passes(steady, 0.0, 1.0 / cut.speed_rev_s, _LEAST_CELLS)
    turn = force[:, -cut.teeth :].sum(axis=(1, 2)) * cut.speed_rev_s
    return turn, float(tangential[-cut.teeth :].sum() * cut.speed_rev_s * cut.radius_m)


def settle(cut: Milling) -> Milling:
    """The cut under load: the depth that compliance leaves, the speed that droop leaves."""
    if "static_compliance" in cut.effects:
        give = cut.effects["static_compliance"]["compliance_m_n"]
        commanded = cut.depth_m
        # the sheet lies at +y in conventional cutting, at -y in climb cutting
        into = -1.0 if cut.milling == "climb" else 1.0

        def gap(depth: float) -> float:
            force, _ = mean_load(Milling(**{**cut.__dict__, "depth_m": depth}))
            return depth - commanded - give * into * float(force[1])

        low, high = 1e-7, 2.0 * cut.radius_m - 1e-7
        if gap(low) >= 0.0:
            depth = low
        else:
            grid = np.linspace(commanded, high, 40) if gap(commanded) < 0 else np.array([commanded])
            above = next((d for d in grid if gap(d) >= 0.0), high)
            depth = brentq(gap, low, above, xtol=1e-9) if gap(above) >= 0 else high
        cut = Milling(**{**cut.__dict__, "depth_m": float(depth)})
    if "spindle_droop" in cut.effects:
        loss = cut.effects["spindle_droop"]["droop_rev_s_nm"]
        free = cut.speed_rev_s

        def lack(speed: float) -> float:
            return speed - free + loss * mean_load(Milling(**{**cut.__dict__, "speed_rev_s": speed}))[1]

        speed = brentq(lack, 0.3 * free, free, xtol=1e-9) if lack(0.3 * free) < 0 else 0.3 * free
        cut = Milling(**{**cut.__dict__, "speed_rev_s": float(speed)})
    return cut


def grid_force(cut: Milling, begin_s: float, count: int, rate_hz: float) -> Array:
    """[count, 3] force on the tool at the times begin_s + i / rate_hz, N, band-limited by the grid only."""
    entry, exit_ = cut.arc()
    passing_s = (exit_ - entry) / (2.0 * np.pi * cut.speed_rev_s)
    cells = int(max(_LEAST_CELLS, np.ceil(1.3 * passing_s * rate_hz)))
    time, force, _, _ = passes(cut, begin_s, begin_s + count / rate_hz, cells)
    place = (time.ravel() - begin_s) * rate_hz
    kept = (place >= 0.0) & (place < count - 1)
    place = place[kept]
    lower = place.astype(np.int64)
    upper = place - lower
    laid = np.empty((count, 3))
    for axis in range(3):
        weight = force[axis].ravel()[kept] * rate_hz
        right = weight * upper
        laid[:, axis] = np.bincount(lower, weight - right, count)[:count]
        laid[:, axis] += np.bincount(lower + 1, right, count)[:count]
    laid[1:-1] = 7.0 / 6.0 * laid[1:-1] - (laid[:-2] + laid[2:]) / 12.0
    return laid


def smear(force: Array, window_s: float, rate_hz: float) -> Array:
    """Moving average over the last `window_s` (the helix); negative looks ahead."""
    if abs(window_s) * rate_hz < 1e-2:
        return force
    count = len(force)
    edge = np.arange(count) + 0.5
    made = np.empty_like(force)
    for axis in range(force.shape[1]):
        total = np.concatenate([[0.0], np.cumsum(force[:, axis])])
        now = np.interp(edge, np.arange(count + 1), total)
        then = np.interp(edge - window_s * rate_hz, np.arange(count + 1), total)
        made[:, axis] = (now - then) / (window_s * rate_hz)
    return made
