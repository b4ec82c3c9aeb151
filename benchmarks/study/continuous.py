"""Drills and turning tools in time: edges always in the material, so the grid of time is all there is.

A drill's lips take the feed since the lip before; thrust out of the hole is positive along z and torque is
carried in the second column, N m. A turning edge stands at the angle pi/2: x feed, y cutting speed, z axis.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from .milling import Array, Milling, along, shear


def loads(cut: Milling, time: Array, drill: bool) -> Array:
    """[T, 3] force on the tool, N; for a drill (0, torque N m, thrust N)."""
    if "spindle_droop" in cut.effects:
        cut = _slowed(cut, drill)
    place = cut.position(time)
    pitch_s = 1.0 / (cut.teeth * cut.speed_rev_s)
    fed = place - cut.position(time - pitch_s)
    ripple = cut.effects.get("torque_ripple")
    if ripple:
        angle = cut.phase_rad + 2.0 * np.pi * cut.speed_rev_s * time
        p, half = ripple["order"], np.pi / cut.teeth
        early = [
            ripple["amplitude"] / p * np.sin(p * a + ripple["phase_rad"]) for a in (angle, angle - 2 * half)
        ]
        fed = fed * (1.0 - (early[0] - early[1]) / (2.0 * half))
    return _forces(cut, np.maximum(fed, 0.0), place, drill)


def _forces(cut: Milling, chip: Array, place: Array, drill: bool) -> Array:
    gain, edge_gain = along(place, cut.effects)
    sheared = shear(chip, cut.effects) * gain
    land = 0.0
    kappa = np.zeros(3)
    if "flank_wear" in cut.effects:
        p = cut.effects["flank_wear"]
        land = p["rate"] * (cut.length_before_m + np.maximum(place, 0.0))
        kappa = np.asarray(p["kappa_n_m2"])
    width = cut.teeth * cut.radius_m if drill else cut.width_m
    tangential, radial, axial = (
        width * (cut.chip_n_m2[i] * sheared[i] + cut.edge_n_m[i] * edge_gain + kappa[i] * land * edge_gain)
        for i in range(3)
    )
    if drill:
        return np.stack([np.zeros_like(axial), tangential * 0.5 * cut.radius_m, axial], axis=1)
    return np.stack([-radial, tangential, -axial], axis=1)


def torque_nm(cut: Milling, drill: bool) -> float:
    """Steady torque against the spindle, N m."""
    chip = np.array([cut.feed_m_s / (cut.teeth * cut.speed_rev_s)])
    steady = replace(cut, effects={k: v for k, v in cut.effects.items() if k in ("size_effect", "ploughing")})
    force = _forces(steady, chip, np.zeros(1), drill)
    return float(force[0, 1] if drill else force[0, 1] * cut.radius_m)


def _slowed(cut: Milling, drill: bool) -> Milling:
    loss, free = cut.effects["spindle_droop"]["droop_rev_s_nm"], cut.speed_rev_s

    def lack(speed: float) -> float:
        return speed - free + loss * torque_nm(replace(cut, speed_rev_s=speed), drill)

    return replace(
        cut, speed_rev_s=float(brentq(lack, 0.3 * free, free)) if lack(0.3 * free) < 0 else 0.3 * free
    )
