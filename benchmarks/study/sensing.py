"""From the force at the tool to the record: structure, sensor, filter, sampling. Filters run in time."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import signal

from .milling import Array

Params = dict[str, Any]


def structure(force: Array, time: Array, position: Array, angle: Array, speed_rev_s: float,
              effects: dict[str, Params], cutting: bool, area_m2: float) -> Array:  # fmt: skip
    """Body forces of the tool, modes and friction, on the fine grid."""
    rate = 1.0 / (time[1] - time[0])
    made = force.copy()
    if "unbalance" in effects:
        p = effects["unbalance"]
        turn = angle + p["phase_rad"]
        made[:, :2] += (
            p["moment_kg_m"] * (2.0 * np.pi * speed_rev_s) ** 2 * np.stack([np.sin(turn), np.cos(turn)], 1)
        )
    if "side_friction" in effects and cutting:
        made[:, 0] -= effects["side_friction"]["drag_pa"] * area_m2
    if "robot_mode" in effects:
        p = effects["robot_mode"]
        for mode in (p, *p.get("others", ())):
            made[:, :2] += _arm(made[:, :2], rate, mode)
    if "clamp_mode" in effects:
        made[:, 1] += _sheet(made[:, 1], position, rate, effects["clamp_mode"])
    if "hysteresis" in effects:
        made[:, 0] -= _drive(time, position, effects["hysteresis"])
    return made


def _arm(force: Array, rate: float, p: Params) -> Array:
    """Inertia felt of one mode of the arm, [T, 2]."""
    way = np.array([np.cos(p["direction_rad"]), np.sin(p["direction_rad"])])
    w = 2.0 * np.pi * p["frequency_hz"]
    inertia = ([-p["mass_ratio"], 0.0, 0.0], [1.0, 2.0 * p["damping"] * w, w * w])
    return signal.lfilter(*_digital(*inertia, w, rate), force @ way)[:, None] * way


def _digital(top: list[float], bottom: list[float], exact_rad_s: float, rate: float) -> tuple[Array, Array]:
    """Bilinear transform that is exact at one frequency, the resonance."""
    return signal.bilinear(top, bottom, fs=0.5 * exact_rad_s / np.tan(0.5 * exact_rad_s / rate))


def _sheet(force: Array, position: Array, rate: float, p: Params) -> Array:
    """Inertia felt of a mode whose frequency goes with position: z' = lam(t) z + F, by blocks."""
    place = np.maximum(position, 0.0)
    changed = 1.0 + place * (p["gradient_1_m"] + place * p["curvature_1_m2"])
    w = 2.0 * np.pi * p["frequency_hz"] * np.maximum(changed, 0.05)
    damped = w * np.sqrt(1.0 - p["damping"] ** 2)
    pole = -p["damping"] * w + 1j * damped
    block = max(16, int(10.0 * rate / (p["damping"] * w.max())))
    z = np.zeros(len(force), complex)
    carried = 0.0j
    for start in range(0, len(force), block):
        here = slice(start, start + block)
        grown = np.cumsum(pole[here]) / rate
        z[here] = np.exp(grown) * (carried + np.cumsum(np.exp(-grown) * force[here]) / rate)
        carried = z[here][-1]
    z -= 0.5 * force / rate
    x = z.imag / damped
    v = z.real - p["damping"] * w * x
    return -p["mass_ratio"] * (force - 2.0 * p["damping"] * w * v - w * w * x)


def _drive(time: Array, position: Array, p: Params) -> Array:
    """LuGre drag along the feed from the start of the motion at time 0 (nothing is strained then)."""
    slid = np.maximum(position, 0.0)
    speed = np.gradient(position, time) * (time >= 0.0)
    return p["coulomb_n"] * (1.0 - np.exp(-slid / p["presliding_m"])) + p["viscous_n_s_m"] * speed


def sense(
    force: Array, time: Array, clock_s: float, effects: dict[str, Params], generator: np.random.Generator
) -> Array:
    """What the transducer makes of the force, before its declared filter."""
    rate = 1.0 / (time[1] - time[0])
    made = force
    if "sensor_resonance" in effects:
        p = effects["sensor_resonance"]
        lateral, axial = (
            (p.get(f"{along}_frequency_ratio", 1.0), p.get(f"{along}_damping_ratio", 1.0))
            for along in ("lateral", "axial")
        )
        each = [
            _rung(made[:, axis], rate, p, *ratios) for axis, ratios in enumerate(((1, 1), lateral, axial))
        ]
        made = np.stack(each, axis=1)
    if "sensor_lowpass" in effects:
        p = effects["sensor_lowpass"]
        made = signal.sosfilt(
            signal.butter(int(p["order"]), p["cutoff_hz"], fs=rate, output="sos"), made, axis=0
        )
    if "crosstalk" in effects:
        xy, xz, yx, yz, zx, zy = effects["crosstalk"]["coupling"]
        made = made @ np.array([[1.0, xy, xz], [yx, 1.0, yz], [zx, zy, 1.0]]).T
    if "thermal_drift" in effects:
        p = effects["thermal_drift"]
        warm = -np.expm1(-(clock_s + np.maximum(time, 0.0)) / p["tau_s"])
        made = made + warm[:, None] * np.asarray(p["drift_n"])
    if "mains_pickup" in effects:
        p = effects["mains_pickup"]
        turn = 2.0 * np.pi * p["frequency_hz"] * time + generator.uniform(0.0, 2.0 * np.pi)
        made = made + np.asarray(p["amplitude_n"]) * np.cos(turn[:, None] + np.asarray(p["phase_rad"]))
    return made


def _rung(force: Array, rate: float, p: Params, frequency_ratio: float, damping_ratio: float) -> Array:
    """One axis [T] behind a resonance whose frequency and damping are so many times those stated."""
    w, damping = 2.0 * np.pi * p["frequency_hz"] * frequency_ratio, p["damping"] * damping_ratio
    return signal.lfilter(*_digital([w * w], [1.0, 2.0 * damping * w, w * w], w, rate), force)


def sampled(force: Array, settle: int, factor: int, alias: Any, rate_hz: float) -> Array:
    """The record: the declared filter on the fine grid, then every `factor`-th sample after the settling."""
    if alias is not None:
        sections = signal.butter(alias.order, alias.hz, fs=rate_hz, output="sos")
        run = signal.sosfiltfilt if alias.zero_phase else signal.sosfilt
        force = run(sections, force, axis=0)
    return force[settle::factor]


def segment_m2(radius_m: float, depth_m: float) -> float:
    """Both faces of a blade inside the sheet, m^2."""
    psi = 2.0 * np.arccos(np.clip(1.0 - depth_m / radius_m, -1.0, 1.0))
    return float(radius_m**2 * (psi - np.sin(psi)))
