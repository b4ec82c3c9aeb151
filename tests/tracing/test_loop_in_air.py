"""Friction of the drive is named where the air before the cuts shows its loop, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.study import Case, make
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.trials.dataset import Dataset

COULOMB_N, PRESLIDING_M = 6.0, 8e-4
EFFECTS = ("radial_runout", "entry_exit", "hysteresis")
BACK_M, FORTH_M, BACK_M_S = 4e-3, 9e-3, 5e-3


def _turns_back_in_air(case: Case, drag, back_m: float = BACK_M) -> Dataset:
    """The trials with a way back and forth in the air before each, and `drag` (position, time) there, N."""
    generator, trials, dataset = np.random.default_rng(8), [], case.dataset
    rate, noise = dataset.sensor.sample_rate_hz, np.asarray(dataset.sensor.noise_std_n)
    for trial in dataset.trials:
        if trial.kind != "cut":
            trials.append(trial)
            continue
        bias = case.truth["trials"][trial.file]["bias_n"]
        travel = along_path(trial)
        forth = (
            travel[0]
            - np.arange(1, round(FORTH_M / trial.feed_speed_m_s * rate)) * trial.feed_speed_m_s / rate
        )
        back = forth[-1] + np.arange(1, max(round(back_m / BACK_M_S * rate), 1)) * BACK_M_S / rate
        place = np.concatenate([back[::-1], forth[::-1], travel])
        before = len(place) - len(travel)
        time = np.arange(len(place)) / rate
        force = np.concatenate([generator.normal(size=(before, 3)) * noise + bias, trial.force_n])
        force[:, 0] -= drag(place, time)
        position = place[:, None] * np.array([1.0, 0.0, 0.0])
        trials.append(replace(trial, time_s=time, force_n=force, position_m=position, spindle_angle_rad=None))
    return replace(dataset, trials=tuple(trials))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [40, 47], ids=["zeroed once", "zeroed before each"])
def test_the_loop_is_named_with_its_force_and_its_way(strained, seed):
    """And the sheet's beginning beside it, which the drag would bend, as geometry has it."""
    case = make("mill", {"entry_exit": "medium"}, seed)
    dragged = _turns_back_in_air(case, lambda x, t: COULOMB_N * strained(x, PRESLIDING_M))
    found = trace(dragged, effects=EFFECTS).verdict
    entry, drag = found["effects"]
    assert found["verdict"] == "explained"
    assert (entry["name"], drag["name"]) == ("entry_exit", "hysteresis")
    assert entry["parameters"]["share"]["value"] == pytest.approx(1.0, abs=0.002)
    assert drag["parameters"]["coulomb_n"]["value"] == pytest.approx(COULOMB_N, rel=0.05)
    assert drag["parameters"]["presliding_m"]["value"] == pytest.approx(PRESLIDING_M, rel=0.03)
    assert any("in the air beside the cut" in said for said in drag["evidence"])


@pytest.mark.slow
def test_what_swings_in_the_air_by_itself_is_no_drag():
    """A slow swing of each record's own, as of a hose."""
    generator = np.random.default_rng(3)

    def swing(place, time):
        return COULOMB_N * np.sin(
            2.0 * np.pi * generator.uniform(0.4, 0.8) * time + generator.uniform(0.0, 6.28)
        )

    case = make("mill", {"entry_exit": "medium"}, 40)
    found = trace(_turns_back_in_air(case, swing), effects=EFFECTS).verdict
    assert "hysteresis" not in [each["name"] for each in found["effects"]]


@pytest.mark.slow
def test_what_settles_in_time_is_no_drag():
    """An amplifier that is switched on with the recorder, on a way that does not turn back."""
    case = make("mill", {"entry_exit": "medium"}, 40)
    settling = _turns_back_in_air(case, lambda x, t: -COULOMB_N * np.expm1(-t / 0.1), back_m=0.0)
    found = trace(settling, effects=EFFECTS).verdict
    assert "hysteresis" not in [each["name"] for each in found["effects"]]
