"""A motor of little inertia gives way between the teeth too, and is not taken for teeth unevenly spaced."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing import predict_trials, trace
from mjx_cutting.trials.dataset import AntiAlias, Dataset, Sensor, ToolInfo, Trial

RATE_HZ, SECONDS, TEETH, RADIUS_M, WIDTH_M = 4000.0, 0.6, 3, 0.006, 0.0015
CHIP_N_M2, EDGE_N_M = np.array([8e8, 2.8e8, 1e8]), np.array([1.5e4, 1e4, 2e3])
NOISE_N, CORNER_HZ = 0.6, 700.0
DROOP = 9.0
FINE = 6000
CUTS = [(60.0, 40, 1.0), (60.0, 90, 1.0), (72.0, 40, 0.4), (72.0, 80, 0.4), (66.0, 90, 0.6), (66.0, 60, 1.0)]


def _over_a_turn(speed: float, feed_m_s: float, depth_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Force [FINE, 3] of straight teeth that cut conventionally, N, and torque [FINE], N m, over a turn."""
    angle = 2.0 * np.pi * (np.arange(FINE) + 0.5) / FINE
    leave = np.arccos(1.0 - depth_m / RADIUS_M)
    force, torque = np.zeros((FINE, 3)), np.zeros(FINE)
    for tooth in range(TEETH):
        own = (angle - 2.0 * np.pi * tooth / TEETH) % (2.0 * np.pi)
        sine, cosine = np.sin(own), np.cos(own)
        chip = feed_m_s / (TEETH * speed) * sine
        t, r, a = (
            (own < leave) * WIDTH_M * (kc * chip + ke) for kc, ke in zip(CHIP_N_M2, EDGE_N_M, strict=True)
        )
        force += np.stack([-t * cosine - r * sine, t * sine - r * cosine, -a], axis=1)
        torque += RADIUS_M * t
    return force, torque


def _cut(free: float, chip_um: float, share: float, swings: bool, seed: int) -> np.ndarray:
    """[T, 3] force of a cut of teeth on circles, N, by a spindle that turns at f0 - droop T(angle)."""
    feed, depth = chip_um * 1e-6 * TEETH * free, share * RADIUS_M
    speed = free
    for _ in range(40):
        force, torque = _over_a_turn(speed, feed, depth)
        rate = free - DROOP * (torque if swings else np.full(FINE, torque.mean()))
        mean = 1.0 / np.mean(1.0 / rate)
        speed = 0.5 * (speed + mean)
    each_s = 1.0 / (rate * FINE)
    ends = np.append(0.0, np.cumsum(each_s))
    impulse = np.concatenate([np.zeros((1, 3)), np.cumsum(force * each_s[:, None], axis=0)])
    samples, rng = int(SECONDS * RATE_HZ), np.random.default_rng(seed)
    edges = np.arange(16 * samples + 1) / (8.0 * RATE_HZ) + rng.uniform(0.0, ends[-1])
    turns, rest = np.divmod(edges, ends[-1])
    until = [turns * whole[-1] + np.interp(rest, ends, whole) for whole in impulse.T]
    felt = np.diff(np.array(until).T, axis=0) * 8.0 * RATE_HZ
    frequency = np.fft.rfftfreq(len(felt), 1.0 / (8.0 * RATE_HZ))
    # what is forward and back through a Butterworth filter of order 4
    gain = 1.0 / (1.0 + (frequency / CORNER_HZ) ** 8)
    passed = np.fft.irfft(np.fft.rfft(felt, axis=0) * gain[:, None], axis=0)
    # far from where the record is closed upon itself
    return passed[::8][samples // 2 :][:samples] + NOISE_N * rng.normal(size=(samples, 3))


def _session(swings: bool) -> Dataset:
    trials = []
    for seed, (free, chip_um, share) in enumerate(CUTS):
        force = _cut(free, chip_um, share, swings, seed)
        trials.append(
            Trial(
                file=f"t{seed}.csv",
                kind="cut",
                time_s=np.arange(len(force)) / RATE_HZ,
                force_n=force,
                spindle_speed_rev_s=free,
                feed_speed_m_s=chip_um * 1e-6 * TEETH * free,
                radial_depth_m=share * RADIUS_M,
                axial_width_m=WIDTH_M,
                milling="conventional",
            )
        )
    sensor = Sensor(RATE_HZ, (NOISE_N,) * 3, anti_alias=AntiAlias(order=4, hz=CORNER_HZ, zero_phase=True))
    return Dataset(
        name="swing", tool=ToolInfo("end_mill", TEETH, 2.0 * RADIUS_M), sensor=sensor, trials=tuple(trials)
    )


@pytest.mark.slow
def test_a_spindle_that_gives_way_between_the_teeth_is_droop_and_nothing_else():
    session = _session(swings=True)
    found = trace(session, effects=("spindle_droop", "torque_ripple", "unequal_pitch", "radial_runout"))
    (named,) = found.verdict["effects"]
    said = named["parameters"]["droop_rev_s_nm"]
    assert named["name"] == "spindle_droop" and found.verdict["verdict"] == "explained"
    assert said["value"] == pytest.approx(DROOP, rel=0.03)
    assert any("within the turn" in each for each in named["evidence"])
    assert found.final.nrmse < 1.15 * found.floor_nrmse
    model = found.model
    (droop,) = model.effects
    steady = replace(model, effects=(type(droop)(droop.droop_rev_s_nm),))
    followed, evenly = (
        np.sqrt(np.sum([np.sum(each.residual_n**2) for each in predict_trials(session, one)]))
        for one in (model, steady)
    )
    assert followed < 0.5 * evenly


@pytest.mark.slow
def test_a_spindle_that_gives_way_to_the_mean_alone_turns_evenly():
    found = trace(_session(swings=False), effects=("spindle_droop", "torque_ripple", "unequal_pitch"))
    (named,) = found.verdict["effects"]
    assert named["name"] == "spindle_droop" and found.verdict["verdict"] == "explained"
    assert found.model.effects[0].bandwidth_hz == 0.0
