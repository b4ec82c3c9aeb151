"""A record that went wrong is left out by name; what all trials show is not blamed on one."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.study.designs import plan
from benchmarks.study.generator import recorded
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.spoiled import spoiled
from mjx_cutting.tracing.trace import _clearer, _settled
from mjx_cutting.trials.dataset import Dataset
from mjx_cutting.trials.synthetic import Hidden


def _with_a_loose_cable(dataset: Dataset) -> Dataset:
    """The third record, of which a fifth is lost in noise."""
    first, second, third, *rest = dataset.trials
    force = third.force_n.copy()
    lost = slice(len(force) // 2, 7 * len(force) // 10)
    force[lost] = np.random.default_rng(0).normal(size=force[lost].shape)
    return replace(dataset, trials=(first, second, replace(third, force_n=force), *rest))


def test_a_spoiled_record_is_left_out_and_nothing_is_missing_in_the_others(mill):
    verdict = trace(_with_a_loose_cable(mill()), effects=["radial_runout", "size_effect"]).verdict
    assert verdict["verdict"] == "nothing missing"
    (out,) = verdict["left_out"]
    assert out["file"] == "t03.csv" and "others" in out["reason"]


def test_the_effect_in_the_others_is_named(mill):
    verdict = trace(_with_a_loose_cable(mill(Hidden(runout_m=1e-5))), effects=["radial_runout"]).verdict
    assert [each["name"] for each in verdict["effects"]] == ["radial_runout"]


def test_what_one_record_leaves_does_not_hide_a_lesser_effect_beside_one_named(mill):
    """The runout is named whatever the third one holds."""
    hidden = Hidden(runout_m=1e-5, size_exponent=0.25)
    found = trace(_with_a_loose_cable(mill(hidden)), effects=["radial_runout", "size_effect"]).verdict
    assert [each["name"] for each in found["effects"]] == ["radial_runout", "size_effect"]
    assert [each["file"] for each in found["left_out"]] == ["t03.csv"]


def test_a_spoiled_record_does_not_hide_how_much_is_missing_in_the_others(mill):
    verdict = trace(_with_a_loose_cable(mill(Hidden(runout_m=2e-6))), effects=["mains_pickup"]).verdict
    assert verdict["verdict"] == "unexplained"
    assert [each["file"] for each in verdict["left_out"]] == ["t03.csv"]


def test_single_samples_far_from_their_neighbours_spoil_nothing(mill):
    dataset = mill(Hidden(runout_m=6e-6))
    force = dataset.trials[1].force_n.copy()
    force[[400, 401, 1500, 3333], 0] += 2000.0
    trials = (dataset.trials[0], replace(dataset.trials[1], force_n=force), *dataset.trials[2:])
    found = trace(replace(dataset, trials=trials), effects=["radial_runout"])
    assert found.verdict["verdict"] == "explained" and not found.verdict["left_out"]
    assert found.verdict["after"]["heldout_nrmse"] < 1.1 * found.verdict["noise_floor_nrmse"]
    assert any(said.startswith("t02.csv: 4 samples far from their neighbours") for said in found.caveats)


def test_what_is_missing_in_every_trial_spoils_none(mill):
    dataset = mill()
    force = 1e3 * np.ones((6, 3))
    for error in ([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [1.0, 1.0, 20.0, 20.0, 1.0, 1.0]):
        left = HeldOut(np.outer(error, np.ones(3)), force, None, np.arange(6))
        assert spoiled(dataset, left) is None
    one = HeldOut(np.outer([1.0, 1.0, 60.0, 1.0, 1.0, 1.0], np.ones(3)), force, None, np.arange(6))
    found = spoiled(dataset, one)
    assert found is not None and found.file == "t03.csv"
    assert spoiled(dataset, one, floor_nrmse=np.sqrt(50.0 / 1e3)) is None


@pytest.mark.parametrize(
    ("without_it", "noise", "found"), [(1.0, 0.0, "t03.csv"), (7.0, 0.0, None), (7.0, 6.5, "t03.csv")]
)
def test_a_trial_is_suspected_without_which_the_others_are_explained(mill, without_it, noise, found):
    """Its own error is no more than a third of all: it spoils the fit to the others as well. Noise, of which
    a squared error holds `noise` of 1e3, is left with and without it."""
    in_lines = np.full((6, 6, 3), 10.0)
    in_lines[2] = without_it
    in_lines[2, 2] = 25.0
    error = np.diagonal(in_lines).T.copy()
    fits = SimpleNamespace(error_n2=in_lines)
    left = HeldOut(error, np.full((6, 3), 1e3), fits, np.arange(6))
    told = spoiled(mill(), left, floor_nrmse=np.sqrt(noise / 1e3))
    assert (None if told is None else told.file) == found


@pytest.mark.parametrize(
    ("levels", "least", "second", "found"),
    [(8, 1.0, 90.0, "t03.csv"), (8, 9.0, 90.0, None), (8, 2.0, 5.0, None), (6, 1.0, 90.0, None)],
    ids=["one against all", "not explained", "no better than another", "few"],
)
def test_a_level_is_suspected_without_which_an_effect_explains_the_others(levels, least, second, found):
    """A fit without a level leaves `second` of a thousand of every other, one without the third `least`."""
    in_lines = np.full((levels, levels, 3), second)
    in_lines[2] = least
    np.einsum("iia->ia", in_lines)[:] = 200.0
    energy, fold = np.full((levels, 3), 1e3), np.arange(levels)
    after = HeldOut(np.full((levels, 3), 200.0), energy, SimpleNamespace(error_n2=in_lines), fold)
    before = HeldOut(np.full((levels, 3), 300.0), energy, None, fold)
    trials = tuple(SimpleNamespace(file=f"t{n + 1:02d}.csv", kind="cut") for n in range(levels))
    drilled = SimpleNamespace(trials=trials, tool=SimpleNamespace(kind="drill"))
    told = spoiled(drilled, before, [(before, after)], floor_nrmse=0.03)
    assert (None if told is None else told.file) == found


def test_a_sheet_of_another_material_is_left_out_though_it_spoils_all_fits(mill):
    dataset = mill()
    third = replace(dataset.trials[2], force_n=0.35 * dataset.trials[2].force_n)
    trials = (*dataset.trials[:2], third, *dataset.trials[3:])
    verdict = trace(replace(dataset, trials=trials), effects=["size_effect"]).verdict
    assert verdict["verdict"] == "nothing missing"
    assert [each["file"] for each in verdict["left_out"]] == ["t03.csv"]


@pytest.mark.slow
def test_a_trial_of_another_feed_than_declared_does_not_hide_a_size_effect():
    design = plan("mill", 401)
    cuts = tuple(
        replace(cut, nominal_rev_s=37.0, speed_rev_s=37.0, feed_m_s=chip_m * design.tool.teeth * 37.0)
        for cut, chip_m in zip(design.cuts, (4e-5, 1e-5, 8e-5, 2e-5, 6e-5, 3e-5, 1.5e-5), strict=False)
    )
    session, (first, *others) = recorded(replace(design, cuts=cuts), {"size_effect": {"exponent": 0.25}}, 401)
    wrong = replace(first, feed_speed_m_s=2.0 * first.feed_speed_m_s)
    told = {"name": "a wrong feed", "source": "benchmarks/study", "licence": "Apache-2.0"}
    trials = (wrong, *others)
    dataset = Dataset(**told, tool=session.tool, sensor=session.sensor, trials=trials)
    verdict = trace(dataset, effects=["size_effect", "ploughing"]).verdict
    assert [each["file"] for each in verdict["left_out"]] == [first.file]
    (named,) = verdict["effects"]
    assert named["name"] == "size_effect" and verdict["verdict"] == "explained"
    assert named["parameters"]["exponent"]["value"] == pytest.approx(0.25, abs=0.01)


def _explained(share: list[float]) -> tuple[HeldOut, HeldOut]:
    """What is left of a trial each without and with an effect, and of which it explains so much."""
    fold, energy = np.arange(len(share)), np.full((len(share), 3), 100.0)
    left = np.full((len(share), 3), 4.0)
    return tuple(
        HeldOut(each, energy, None, fold) for each in (left, left * (1.0 - np.array(share))[:, None])
    )


@pytest.mark.parametrize(
    ("share", "opposed"),
    [
        ([0.6, 0.7, 0.4, -0.2, 0.6, 0.7], True),
        ([0.6, 0.7, 0.4, 0.1, 0.6, 0.7], False),
        ([0.6, 0.7, 0.1, -0.2, 0.6, 0.7], False),
        ([0.6, 0.7, -0.2, 0.6, 0.7], False),
    ],
    ids=["opposed", "not worse", "another not explained", "too few"],
)
def test_one_trial_that_what_explains_the_others_makes_worse_is_told(mill, share, opposed):
    dataset = mill()
    cuts = dataset.trials[: len(share)]
    left, after = _explained(share)
    found = spoiled(replace(dataset, trials=cuts), left, [(left, after)])
    assert (found is not None) is opposed
    if opposed:
        assert found.file == cuts[3].file and "where on the path its record begins" in found.reason


@pytest.mark.parametrize(
    ("word", "left", "how_far"),
    [
        ("unexplained", 0.2, 0), ("partly explained", 0.2, 1), ("ambiguous", 0.2, 1), ("ambiguous", 0.02, 2),
        ("explained", 0.02, 2),
    ],
)  # fmt: skip
def test_an_ambiguous_name_settles_matters_only_where_little_is_left(word, left, how_far):
    found = _leaving(left)
    found.verdict = {"verdict": word}
    assert _settled(found) == how_far


@pytest.mark.parametrize(
    ("was", "left", "clearer"),
    [
        (0.0320, 0.0210, True),  # two thirds of the whole, a quarter of it beside noise
        (0.0320, 0.0240, False),
        (0.0215, 0.0200, False),  # what was left was noise
    ],
)
def test_what_a_trial_less_leaves_is_weighed_beside_the_noise(was, left, clearer):
    assert _clearer(_leaving(left), _leaving(was)) is clearer


def _leaving(nrmse: float) -> SimpleNamespace:
    search = SimpleNamespace(problem=SimpleNamespace(tolerance=0.003))
    return SimpleNamespace(final=SimpleNamespace(nrmse=nrmse), floor_nrmse=0.02, search=search)
