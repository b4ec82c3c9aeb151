"""Materials that enough trials are of have constants of their own; labels of like sheets change nothing."""

from __future__ import annotations

import json
from dataclasses import replace

import jax
import numpy as np
import pytest

from benchmarks.study import make
from benchmarks.study.fewer import FEWER
from mjx_cutting import _platform
from mjx_cutting.cutting import ForceModel
from mjx_cutting.tracing import save, trace
from mjx_cutting.tracing.fitting.sheets import Sheets, materials_of
from mjx_cutting.tracing.materials import of_known_materials
from mjx_cutting.trials.dataset import AntiAlias, Dataset, Sensor, ToolInfo
from mjx_cutting.trials.synthetic import Conditions, Hidden, Sheet, make_trials

EFFECTS = ["radial_runout"]
TRUE = {
    "hard": ((8e8, 2.4e8, 1e8), (1e4, 1e4, 2e3)),
    "rubbing": ((5e8, 1.6e8, 8e7), (2.1e4, 1.5e4, 3e3)),
}


def _labelled(dataset: Dataset, names: list[str]) -> Dataset:
    trials = (replace(trial, material=name) for trial, name in zip(dataset.trials, names, strict=True))
    return replace(dataset, trials=tuple(trials))


def _with_two_of_another(dataset: Dataset, factor: float) -> Dataset:
    """The second and sixth trial with a force so much larger, of a sheet of its own name."""
    names = ["steel", "brass", "steel", "steel", "steel", "brass"]
    trials = [
        replace(trial, force_n=factor * trial.force_n) if name == "brass" else trial
        for trial, name in zip(dataset.trials, names, strict=True)
    ]
    return _labelled(replace(dataset, trials=tuple(trials)), names)


def test_what_is_cut_of_another_material_is_left_out_by_name(mill):
    verdict = trace(_with_two_of_another(mill(Hidden(runout_m=1e-5)), 0.4), effects=EFFECTS).verdict
    assert [each["name"] for each in verdict["effects"]] == ["radial_runout"]
    assert verdict["after"]["heldout_nrmse"] < 1.2 * verdict["noise_floor_nrmse"]
    assert [each["file"] for each in verdict["left_out"]] == ["t02.csv", "t06.csv"]
    assert all("'brass'" in each["reason"] and "4 trials" in each["reason"] for each in verdict["left_out"])


def _hard_and_rubbing(hidden: Hidden | None = None) -> tuple[Dataset, list[str]]:
    """Trials of two materials by turns, and their names: one is harder to cut, the other rubs more."""
    cuts = [
        Conditions(speed, speed * 4 * chip, 0.016, 0.002)
        for speed in (40.0, 60.0)
        for chip in (1e-5, 2e-5, 4e-5, 8e-5)
    ]
    tool, sensor = (
        ToolInfo("end_mill", 4, 0.016),
        Sensor(5000.0, (0.3,) * 3, anti_alias=AntiAlias(order=4, hz=1000.0)),
    )
    hard, rubbing = (
        make_trials(tool, Sheet(*constants), cuts, sensor, hidden=hidden, duration_s=0.5, seed=3)
        for constants in TRUE.values()
    )
    names = ["hard", "rubbing"] * 4
    trials = tuple(
        replace(one if name == "hard" else other, material=name)
        for one, other, name in zip(hard.trials, rubbing.trials, names, strict=True)
    )
    return replace(hard, trials=trials), names


def test_materials_are_told_apart_by_their_constants_though_the_forces_are_as_large():
    dataset, names = _hard_and_rubbing()
    twice = (replace(trial, file=f"again {trial.file}") for trial in dataset.trials[::2])
    alike = _labelled(replace(dataset, trials=(*dataset.trials[::2], *twice)), names)
    with _platform.x64():
        found = of_known_materials(dataset, (0.0, 1000.0))
        same = of_known_materials(alike, (0.0, 1000.0))
    assert [each.material for each in found.trials] == names and found.left_out == ()
    assert len({each.material for each in same.trials}) == 1 and same.left_out == () and len(same.trials) == 8


def test_each_material_has_constants_of_its_own_beside_one_tool():
    dataset, names = _hard_and_rubbing(Hidden(runout_m=4e-6))
    found = trace(dataset, effects=["radial_runout", "size_effect", "flank_wear"])
    assert found.verdict["verdict"] == "explained" and found.verdict["left_out"] == []
    (runout,) = found.verdict["effects"]
    assert runout["name"] == "radial_runout"
    assert runout["parameters"]["offset_m"]["value"] == pytest.approx(4e-6, rel=0.03)
    first, others = materials_of(found.dataset)[0], 1
    mine = found.search.final_fit.model
    sheets = next(each for each in mine.effects if isinstance(each, Sheets))
    cut = found.search.problem.cut
    own = [
        sheets.constants(mine.material, jax.tree.map(lambda leaf, i=i: leaf[i], cut), mine) for i in (0, 1)
    ]
    assert first in names and np.asarray(sheets.share).shape == (others, 6)
    for material, name in zip(own, names[:2], strict=True):
        chip, edge = TRUE[name]
        np.testing.assert_allclose(material.chip_n_m2, chip, rtol=0.03)
        np.testing.assert_allclose(material.edge_n_m[:2], edge[:2], rtol=0.1)
    said = next(each for each in found.caveats if "constants of their own" in each)
    assert "'rubbing' (4 trials)" in said or "'hard' (4 trials)" in said


def test_the_model_saved_is_that_of_the_first_material(tmp_path):
    dataset, _ = _hard_and_rubbing()
    found = trace(dataset, effects=["radial_runout"])
    save(found, tmp_path)
    model = ForceModel.from_dict(json.loads((tmp_path / "model.json").read_text()))
    assert model.effects == ()
    chip, _ = TRUE[materials_of(found.dataset)[0]]
    np.testing.assert_allclose(model.material.chip_n_m2, chip, rtol=0.03)
    assert "constants of their own" in (tmp_path / "report.html").read_text()


def test_a_saw_of_which_only_the_mean_force_shows_is_judged_where_it_cuts(saw):
    """Its teeth pass faster than the sensor follows. The zero of each record takes that mean for its own,
    unless the air before the cut and behind it says what it is."""
    trials = []
    for index, trial in enumerate(saw().trials):
        inside = (trial.time_s > 0.4 + 0.1 * index) & (trial.time_s < 3.6 - 0.1 * (index % 3))
        mean = (0.5 if index == 3 else 1.0) * trial.force_n.mean(axis=0)
        noise = np.random.default_rng(index).normal(0.0, 0.1, trial.force_n.shape)
        name = "card" if index == 3 else "brass"
        trials.append(replace(trial, force_n=inside[:, None] * mean + noise, material=name))
    dataset = replace(saw(), trials=tuple(trials))
    with _platform.x64():
        found = of_known_materials(dataset, (0.0, 200.0))
    assert [each.file for each in found.left_out] == [trials[3].file]


@pytest.mark.parametrize(
    ("names", "kept"), [(["brass", "card"] * 4, 2), ([f"sheet {i}" for i in range(8)], 1)]
)
def test_labels_are_believed_where_the_model_shows_little(saw, names, kept):
    """A zero of each trial's own takes the mean, and no line of the teeth is heard: what is left tells
    nothing of the sheets. Of labels that few trials are of, none is for constants of its own."""
    trials = []
    for index, name in enumerate(names):
        force_n = np.random.default_rng(index).normal(3.0, 0.3, (2000, 3))
        trial = replace(saw().trials[index % 5], time_s=np.arange(2000) / 500.0, force_n=force_n)
        trials.append(replace(trial, file=f"t{index}.csv", material=name))
    with _platform.x64():
        found = of_known_materials(replace(saw(), trials=tuple(trials)), (0.0, 100.0))
    assert len({each.material for each in found.trials}) == kept and found.left_out == ()


def test_materials_are_told_apart_by_what_little_changes_under_a_filter():
    """Each trial has a zero of its own, and of the teeth a hundredth of the force is heard."""
    whole = make("saw", {}, seed=17014).dataset
    softer = FEWER["materials"](whole)
    assert softer.sensor.zeroed == "trial"
    pairs = zip(whole.trials, softer.trials, strict=True)
    alike = replace(whole, trials=tuple(replace(each, material=soft.material) for each, soft in pairs))
    with _platform.x64():
        found, same = (of_known_materials(each, (0.0, 200.0)) for each in (softer, alike))
    assert {each.material for each in found.trials if each.kind == "cut"} == {"harder", "softer"}
    assert len({each.material for each in same.trials}) == 1


def test_labels_of_sheets_that_are_alike_leave_none_out(mill):
    dataset = _labelled(mill(), ["sheet 1"] * 4 + ["sheet 2"] * 2)
    verdict = trace(dataset, effects=EFFECTS).verdict
    assert verdict["verdict"] == "nothing missing" and verdict["left_out"] == []


def test_the_material_asked_for_is_traced(mill):
    dataset = _with_two_of_another(mill(), 0.4)
    verdict = trace(dataset, effects=EFFECTS, material="brass").verdict
    assert [each["file"] for each in verdict["left_out"]] == [f"t0{index}.csv" for index in (1, 3, 4, 5)]
    with pytest.raises(ValueError, match=r"got 'mica', expected one of the cut trials' \(brass, steel\)"):
        trace(dataset, effects=EFFECTS, material="mica")


def test_without_labels_all_trials_are_of_known_materials(mill):
    verdict = trace(mill(), effects=EFFECTS).verdict
    assert verdict["left_out"] == [] and np.isfinite(verdict["before"]["heldout_nrmse"])
