"""A tool that vibrates across the path, measured, and the flanks that rub on what they leave."""

from __future__ import annotations

from typing import Any

import numpy as np

from .milling import Array, Milling

ENCODER_M = 1e-7
Params = dict[str, Any]


def motion(time: Array, index: int, p: Params) -> tuple[Array, Array]:
    """Place into the sheet [T], m, and its rate, m/s, in the trial of an index: two lines."""
    drawn = np.random.default_rng([p["seed"], index])
    place, rate = np.zeros(len(time)), np.zeros(len(time))
    for size_m in (p["vibration_m"], 0.3 * p["vibration_m"]):
        turn, start = 2.0 * np.pi * drawn.uniform(*p["between_hz"]), drawn.uniform(0.0, 2.0 * np.pi)
        place += size_m * np.sin(turn * time + start)
        rate += size_m * turn * np.cos(turn * time + start)
    return place, rate


def rubbing(work: Milling, time: Array, p: Params) -> Array:
    """[T, 3] force on the tool of the flanks that rub, those of the teeth in the cut, of a straight edge that
    moves into the sheet at 1 m/s, N."""
    force = np.zeros((len(time), 3))
    entry, exit_ = work.arc()
    speed = 2.0 * np.pi * work.radius_m * work.speed_rev_s
    turned = work.phase_rad + 2.0 * np.pi * work.speed_rev_s * time
    for lag in work.lags():
        angle = np.mod(turned - lag, 2.0 * np.pi)
        pressed = p["damping_n_m"] * work.width_m * np.cos(angle) / speed
        pressed = np.where((angle > entry) & (angle < exit_), pressed, 0.0)
        force[:, 0] -= pressed * np.sin(angle)
        force[:, 1] -= pressed * np.cos(angle)
    return force


def encoded(time: Array, index: int, p: Params) -> Array:
    """What a sensor of the place shows of it [T], m."""
    noise = np.random.default_rng([p["seed"], index, 1]).normal(size=len(time))
    return motion(time, index, p)[0] + ENCODER_M * noise
