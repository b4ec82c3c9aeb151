"""Records with more air than cut: entry is named where the tool goes in by geometry, wherever that is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.entered import _one_place
from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.trials.dataset import Dataset


def _after_long_air(dataset: Dataset, located: bool) -> Dataset:
    """The trials with half a record of air or more before each, of a length of its own; with positions along
    the path or without any."""
    generator, trials = np.random.default_rng(8), []
    rate, noise = dataset.sensor.sample_rate_hz, np.asarray(dataset.sensor.noise_std_n)
    for index, trial in enumerate(dataset.trials):
        before = round((0.5 + 0.1 * (index % 4)) * len(trial.time_s)) if trial.kind == "cut" else 0
        force = np.concatenate([generator.normal(size=(before, 3)) * noise, trial.force_n])
        time = np.arange(len(force)) / rate
        travel = along_path(trial)[0] + trial.feed_speed_m_s * (time - before / rate)
        position = travel[:, None] * np.array([1.0, 0.0, 0.0]) if located else None
        trials.append(replace(trial, time_s=time, force_n=force, position_m=position, spindle_angle_rad=None))
    return replace(dataset, trials=tuple(trials))


@pytest.mark.slow
@pytest.mark.parametrize("located", [True, False])
def test_entry_behind_long_air(located, names_the_edge):
    """Without positions every record has a place of its own, and positions count from the sheet's edge."""
    case = make("mill", {"entry_exit": "medium"}, 45)
    found = trace(_after_long_air(case.dataset, located), effects=("radial_runout", "entry_exit")).verdict
    if located:
        return names_the_edge(found, case.truth["effects"]["entry_exit"]["start_m"])
    (named,) = found["effects"]
    assert named["name"] == "entry_exit" and named["parameters"]["start_m"]["value"] == 0.0
    assert named["parameters"]["share"]["value"] == pytest.approx(1.0, abs=0.05)
    assert named["parameters"]["by_axis"]["value"] == 1.0
    assert any("each record's own" in sentence for sentence in named["evidence"])
    assert any("where the tool's axis meets the edge" in sentence for sentence in named["evidence"])
    assert found["after"]["heldout_nrmse"] < 0.1 * found["before"]["heldout_nrmse"]


@pytest.mark.slow
def test_a_tool_that_is_lowered_into_the_sheet_is_no_entry(saw):
    """Within tenths of a second, where geometry takes seconds."""
    made, trials, generator = saw(), [], np.random.default_rng(4)
    for trial in made.trials:
        first, last = generator.uniform(0.5, 0.8), trial.time_s[-1] - generator.uniform(0.4, 0.6)
        inside = np.clip(np.minimum(trial.time_s - first, last - trial.time_s) / 0.12, 0.0, 1.0)
        force = trial.force_n * inside[:, None] + 0.1 * generator.normal(size=trial.force_n.shape)
        trials.append(replace(trial, force_n=force))
    found = trace(replace(made, trials=tuple(trials)), effects=("radial_runout", "entry_exit")).verdict
    assert found["effects"] == [] and "enters or leaves the sheet" in found["remaining"]["description"]


def test_one_place_is_the_rims_or_the_axis():
    reach = np.array([8e-3, 8e-3, 12e-3, 12e-3])
    for by_axis in (0.0, 1.0):
        place, met = _one_place(5e-3 - by_axis * reach, reach)
        assert met == by_axis and place.value == pytest.approx(5e-3)
    assert _one_place(np.array([0.0, 2e-3, 4e-3, 1e-3]), reach) is None
    assert _one_place(np.array([5e-3, 5e-3, -np.inf, -np.inf]), reach) is None
