"""Trials made by calculation, for use where no measured ones are at hand and for testing what reads trials.

Written apart from `mjx_cutting.cutting` and in another way, so that agreement between the two means
something: the surface that each tooth leaves is tracked over the angle, tooth after tooth, on 7,200 angles a
turn, instead of evaluating a closed form for the chip; on the true path, where a tooth was when it left that
surface is found by iteration; filters are run in time on an oversampled record. Steady cuts only: a trial
begins and ends in full engagement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

Array = NDArray[np.float64]
_ANGLES = 7200
_TURNS = 4
_ITERATIONS = 12
_CUSPS_RAD = 0.3
_HELIX_SLICES = 24
_OVERSAMPLED_HZ = 100_000.0
_SETTLE_S = 0.2


@dataclass(frozen=True)
class Conditions:
    """One steady cut: spindle speed, feed, radial depth, axial width, and how it is milled."""

    spindle_speed_rev_s: float
    feed_speed_m_s: float
    radial_depth_m: float
    axial_width_m: float
    milling: str = "slot"


@dataclass(frozen=True)
class Sheet:
    """What is cut: tangential, radial and axial chip constants [3], N/m^2, and edge constants [3], N/m."""

    chip_n_m2: tuple[float, float, float]
    edge_n_m: tuple[float, float, float]


@dataclass(frozen=True)
class Hidden:
    """Effects put into the trials; all absent by default.

    runout_m and runout_angle_rad; pitch_error_rad, one a tooth; size_exponent (Kienzle, about 50 um);
    resonance_hz and resonance_damping of the sensor; true_path: teeth on trochoids, not on circles; cusps: as
    well as the cusps that these leave on the side of the cut, which the edges meet beyond the nominal arc.
    """

    runout_m: float = 0.0
    runout_angle_rad: float = 0.0
    pitch_error_rad: tuple[float, ...] = ()
    size_exponent: float = 0.0
    resonance_hz: float = 0.0
    resonance_damping: float = 0.05
    true_path: bool = False
    cusps: bool = False


def make_trials(
    tool: ToolInfo,
    sheet: Sheet,
    conditions: Sequence[Conditions],
    sensor: Sensor,
    *,
    hidden: Hidden | None = None,
    duration_s: float = 1.0,
    speed_error: float = 0.002,
    bias_n: float = 1.0,
    seed: int = 0,
    name: str = "synthetic",
) -> Dataset:
    """A dataset of steady cuts.

    Arguments:
        tool, sheet, conditions, sensor: what cuts what, how, and what records it; the sensor's stated
            noise is added.
        hidden: effects in the trials that no model has been told of.
        duration_s: length of each trial.
        speed_error: standard deviation of the spindle's relative deviation from nominal.
        bias_n: standard deviation of each axis' bias, N; one a trial, or one for all where zeroed once a
            session.
        seed: of phases, speeds, biases and noise.
    """
    generator = np.random.default_rng(seed)
    hidden = hidden or Hidden()
    session = generator.normal(0.0, bias_n, 3)
    trials = []
    for index, each in enumerate(conditions):
        speed = each.spindle_speed_rev_s * (1.0 + np.clip(generator.normal(0.0, speed_error), -0.009, 0.009))
        bias = session if sensor.zeroed == "session" else generator.normal(0.0, bias_n, 3)
        phase = generator.uniform(0.0, 2.0 * np.pi)
        true = replace(each, spindle_speed_rev_s=speed)
        time, force = _record(tool, sheet, true, sensor, hidden, duration_s, phase)
        noise = sensor.noise_std_n or (0.0, 0.0, 0.0)
        trials.append(
            Trial(
                file=f"t{index + 1:02d}.csv",
                kind="cut",
                milling=each.milling,  # type: ignore[arg-type]
                spindle_speed_rev_s=each.spindle_speed_rev_s,
                feed_speed_m_s=each.feed_speed_m_s,
                radial_depth_m=each.radial_depth_m,
                axial_width_m=each.axial_width_m,
                time_s=time,
                force_n=force + bias + generator.normal(size=force.shape) * np.asarray(noise),
            )
        )
    return Dataset(
        name=name,
        source="made by calculation with mjx_cutting.trials.synthetic",
        licence="Apache-2.0",
        tool=tool,
        sensor=sensor,
        trials=tuple(trials),
    )


def one_turn(tool: ToolInfo, sheet: Sheet, cut: Conditions, hidden: Hidden) -> Array:
    """[angles, 3] force on the tool over one turn of tooth 0, process axes, N."""
    teeth, radius = tool.teeth, 0.5 * tool.diameter_m
    error = np.asarray(hidden.pitch_error_rad or np.zeros(teeth))
    late = np.cumsum(error - error.mean())
    lag = 2.0 * np.pi * np.arange(teeth) / teeth + late - late.mean()
    reach = hidden.runout_m * np.cos(hidden.runout_angle_rad - 2.0 * np.pi * np.arange(teeth) / teeth)
    angle = 2.0 * np.pi * (np.arange(_ANGLES) + 0.5) / _ANGLES
    exit_ = (
        np.pi if cut.milling == "slot" else np.arccos(np.clip(1.0 - cut.radial_depth_m / radius, -1.0, 1.0))
    )
    entry = np.pi - exit_ if cut.milling == "climb" else 0.0
    last = np.pi if cut.milling == "climb" else exit_
    beside = _CUSPS_RAD if hidden.cusps else 0.0
    inside = (angle >= entry) & (angle <= last + beside * (last == np.pi))
    inside |= (angle - 2.0 * np.pi >= entry - beside) & (entry == 0.0)
    advance_m_rad = cut.feed_speed_m_s / (2.0 * np.pi * cut.spindle_speed_rev_s)
    if hidden.true_path:
        chips = _on_true_path(angle, lag, radius + reach, advance_m_rad)
    else:
        chips = _on_circles(angle, lag, reach, advance_m_rad)
    wave = np.zeros((_ANGLES, 3))
    for tooth in range(teeth):
        local = _edge(chips[tooth], sheet, hidden) * (inside & (chips[tooth] > 0.0))[:, None]
        turned = np.stack(
            [
                -local[:, 0] * np.cos(angle) - local[:, 1] * np.sin(angle),
                local[:, 0] * np.sin(angle) - local[:, 1] * np.cos(angle),
                -local[:, 2],
            ],
            axis=1,
        )
        wave += _delayed(turned, lag[tooth])
    slices = 1 if tool.helix_rad == 0.0 else _HELIX_SLICES
    whole_lag = 2.0 * cut.axial_width_m * np.tan(tool.helix_rad) / tool.diameter_m
    share = (np.arange(slices) + 0.5) / slices
    return cut.axial_width_m / slices * np.sum([_delayed(wave, whole_lag * each) for each in share], axis=0)


def _on_circles(angle: Array, lag: Array, reach: Array, advance_m_rad: float) -> Array:
    """[teeth, angles] chip of each tooth; below zero where it does not reach the sheet."""
    teeth = len(lag)
    surface = np.full(_ANGLES, reach.max())
    chips = np.zeros((teeth, _ANGLES))
    before = lag[-1] - 2.0 * np.pi
    for _ in range(_TURNS):
        for tooth in range(teeth):
            fed = (lag[tooth] - before) % (2.0 * np.pi) if teeth > 1 else 2.0 * np.pi
            surface = surface - fed * advance_m_rad * np.sin(angle)
            chips[tooth] = reach[tooth] - surface
            surface = np.maximum(surface, reach[tooth])
            before = lag[tooth]
    return chips


def _on_true_path(angle: Array, lag: Array, radius: Array, advance_m_rad: float) -> Array:
    """The same of teeth at `radius` [teeth]: how far each is beyond where those of the turn before were on
    the ray from the tool's centre."""
    teeth = len(lag)
    chips = np.full((teeth, _ANGLES), np.inf)
    sine, cosine = np.sin(angle), np.cos(angle)
    for tooth in range(teeth):
        for m in range(1, teeth + 1):
            earlier = (tooth - m) % teeth
            apart = (lag[tooth] - lag[earlier]) % (2.0 * np.pi) if m < teeth else 2.0 * np.pi
            advance = np.full(_ANGLES, apart * advance_m_rad)
            for _ in range(_ITERATIONS):
                along = np.sqrt(radius[earlier] ** 2 - (advance * cosine) ** 2) - advance * sine
                then = np.arctan2(along * sine + advance, along * cosine)
                turned = np.mod(angle - then + np.pi, 2.0 * np.pi) - np.pi
                advance = (apart + turned) * advance_m_rad
            chips[tooth] = np.minimum(chips[tooth], radius[tooth] - along)
    return chips


def _edge(chip: Array, sheet: Sheet, hidden: Hidden) -> Array:
    """[angles, 3] force per width, N/m, for chips above zero."""
    thick = np.maximum(chip, 1e-12)
    power = thick * (thick / 5e-5) ** -hidden.size_exponent
    return np.asarray(sheet.edge_n_m) + power[:, None] * np.asarray(sheet.chip_n_m2)


def _delayed(wave: Array, lag_rad: float) -> Array:
    """The wave of a tooth that passes `lag_rad` later, by linear interpolation over the turn."""
    shift = lag_rad * _ANGLES / (2.0 * np.pi)
    whole = int(np.floor(shift))
    part = shift - whole
    return (1.0 - part) * np.roll(wave, whole, axis=0) + part * np.roll(wave, whole + 1, axis=0)


def _record(
    tool: ToolInfo,
    sheet: Sheet,
    cut: Conditions,
    sensor: Sensor,
    hidden: Hidden,
    duration_s: float,
    phase: float,
) -> tuple[Array, Array]:
    rate = sensor.sample_rate_hz
    factor = max(1, int(np.ceil(_OVERSAMPLED_HZ / rate)))
    fine = rate * factor
    count = round(duration_s * rate)
    settle = int(np.ceil(_SETTLE_S * rate)) * factor
    time = (np.arange(count * factor + settle) - settle) / fine
    wave = one_turn(tool, sheet, cut, hidden)
    turn = np.mod(cut.spindle_speed_rev_s * time + phase / (2.0 * np.pi), 1.0) * _ANGLES - 0.5
    grid = np.arange(-1, _ANGLES + 1)
    closed = np.concatenate([wave[-1:], wave, wave[:1]])
    force = np.stack([np.interp(turn, grid, closed[:, axis]) for axis in range(3)], axis=1)
    if hidden.resonance_hz > 0.0:
        natural = 2.0 * np.pi * hidden.resonance_hz
        analog = ([natural**2], [1.0, 2.0 * hidden.resonance_damping * natural, natural**2])
        force = signal.lfilter(*signal.bilinear(*analog, fs=fine), force, axis=0)
    if sensor.anti_alias is not None:
        alias = sensor.anti_alias
        sections = signal.butter(alias.order, alias.hz, fs=fine, output="sos")
        run = signal.sosfiltfilt if alias.zero_phase else signal.sosfilt
        force = run(sections, force, axis=0)
    kept = force[settle::factor]
    return np.arange(len(kept)) / rate, kept
