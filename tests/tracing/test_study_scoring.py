"""How the injection study marks verdicts, keeps its log and fits its peers."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks import tracing_study as study
from benchmarks.study import cases, isolability, peers, scoring, strengths, tables
from benchmarks.study import designs as generator


def verdict(*names, tied=(), second=None, **parameters):
    effects = [
        {"name": name, "parameters": parameters.get(name, {}), "runner_up": second and {"name": second}}
        for name in names
    ]
    return {
        "verdict": "explained" if names else "unexplained",
        "effects": effects,
        "ambiguous": [{"names": list(tied)}] if tied else [],
        "before": {"heldout_nrmse": 0.3},
        "after": {"heldout_nrmse": 0.1},
        "noise_floor_nrmse": 0.1,
        "remaining": {"depends_on": []},
    }


PAIR = ["radial_runout", "flank_wear"]


@pytest.mark.parametrize(
    ("kind", "hidden", "said", "top1", "top2", "refused", "wrong"),
    [
        ("single", ["radial_runout"], verdict("radial_runout"), True, True, False, False),
        ("single", ["radial_runout"], verdict("crosstalk", second="radial_runout"), False, True, False, True),
        ("single", ["radial_runout"], verdict(), False, False, True, False),
        ("single", ["radial_runout"], verdict("radial_runout", "crosstalk"), True, True, False, True),
        ("pair", PAIR, verdict("flank_wear", "radial_runout"), True, True, False, False),
        ("pair", PAIR, verdict("flank_wear"), False, False, False, False),
        ("nothing", [], verdict(), False, False, True, False),
        ("outside", ["gain_switching"], verdict("flank_wear"), False, False, False, True),
    ],
)  # fmt: skip
def test_marks(kind, hidden, said, top1, top2, refused, wrong):
    inside = {name: {} for name in hidden if name != "gain_switching"}
    truth = {"effects": {name: {"offset_m": 1.0, "kappa_n_m2": [1.0]} for name in inside}}
    row = scoring.marked(cases.Question(kind, "saw", tuple(hidden), "medium", 0), truth, said)
    assert (row["top1"], row["top2"], row["refused"], row["wrong"]) == (top1, top2, refused, wrong)


def test_parameter_error_and_coverage():
    told = {"offset_m": {"value": 1.1e-5, "low": 1.05e-5, "high": 1.2e-5, "unit": "m"}}
    said = verdict("radial_runout", radial_runout=told)
    question = cases.Question("single", "saw", ("radial_runout",), "medium", 0)
    row = scoring.marked(question, {"effects": {"radial_runout": {"offset_m": 1e-5}}}, said)
    assert row["parameters"]["radial_runout"]["relative_error"] == pytest.approx(0.1)
    assert row["parameters"]["radial_runout"]["covered"] == 0.0
    error = np.array([0.02, -0.01, 0.0, -0.01])
    width = {
        "value": np.roll(error, 2) + 1e-4,
        "low": np.roll(error, 2) - 1e-3,
        "high": np.roll(error, 2) + 1e-3,
    }
    said = verdict("unequal_pitch", unequal_pitch={"pitch_error_rad": width})
    question = cases.Question("single", "mill", ("unequal_pitch",), "medium", 0)
    row = scoring.marked(question, {"effects": {"unequal_pitch": {"pitch_error_rad": error}}}, said)
    assert row["parameters"]["unequal_pitch"]["covered"] == 1.0
    assert row["parameters"]["unequal_pitch"]["relative_error"] < 0.02


@pytest.mark.parametrize(("design", "covered"), [("drill", 1.0), ("turning", 2.0 / 3.0)])
def test_a_direction_that_no_channel_shows_is_not_counted(design, covered):
    hum = {"value": 0.5, "values": [0.0, 0.4, 0.5], "lows": [0.0, 0.3, 0.4], "highs": [0.0, 0.5, 0.6]}
    said = verdict("mains_pickup", mains_pickup={"amplitude_n": hum | {"low": 0.4, "high": 0.6}})
    truth = {"effects": {"mains_pickup": {"amplitude_n": [0.3, 0.4, 0.5]}}}
    row = scoring.marked(cases.Question("single", design, ("mains_pickup",), "weak", 0), truth, said)
    assert row["parameters"]["mains_pickup"]["covered"] == pytest.approx(covered)
    assert (row["parameters"]["mains_pickup"]["relative_error"] < 1e-12) == (design == "drill")


def test_cases_are_distinct_and_can_be_made():
    every = list(cases.questions(["mill", "saw", "drill", "turning"], [0]))
    assert len({each.key for each in every}) == len(every) > 200
    chosen = list(cases.questions(["saw"], [0, 1], ["radial_runout", "nothing"]))
    assert {each.effects for each in chosen} == {("radial_runout",), ()} and len(chosen) == 8
    strong = list(cases.questions(["saw"], [0], strengths=["strong"]))
    assert {each.strength for each in strong if each.kind == "single"} == {"strong"}
    assert {each.key for each in strong} < {each.key for each in every}
    assert {each.kind for each in strong} == {each.kind for each in every if each.design == "saw"}
    for each in every:
        if each.seed == 0 and each.strength in ("medium", "strong"):
            session = generator.plan(each.design, 0, each.effects)
            for name in each.effects:
                assert strengths.draw(name, session, each.strength, np.random.default_rng(0))


def test_a_log_cut_short_is_read_and_a_repeated_case_counts_once(tmp_path):
    row = {
        "key": "k", "kind": "single", "design": "saw", "effects": ["radial_runout"], "strength": "weak",
        "seed": 0, "verdict": "explained", "named": ["radial_runout"], "top1": True, "top2": True,
        "refused": False, "wrong": False, "before": 0.3, "after": 0.1, "floor": 0.1, "parameters": {},
    }  # fmt: skip
    log = tmp_path / "log.jsonl"
    lines = [json.dumps({**row, "top1": False}), json.dumps(row), json.dumps({**row, "key": "m"})]
    log.write_text("\n".join(lines) + '\n{"key": "cut', encoding="utf-8")
    found = tables.gathered(study.read(log))
    assert found["cases"] == 2 and found["groups"][0]["sessions"] == 2 and found["groups"][0]["top1"] == 1.0
    assert "radial_runout" in tables.printed(found)
    tables.draw(found, tmp_path / "map.png")
    assert (tmp_path / "map.png").stat().st_size > 5000


def test_sparse_regression_keeps_the_true_terms_only():
    rng = np.random.default_rng(0)
    library = rng.normal(size=(4000, 12))
    target = np.stack([2.0 * library[:, 3] - library[:, 7], 0.5 * library[:, 1]], axis=1)
    weights = peers.stlsq(library, target + 0.05 * rng.normal(size=target.shape))
    assert set(np.flatnonzero(weights[:, 0])) == {3, 7} and set(np.flatnonzero(weights[:, 1])) == {1}
    np.testing.assert_allclose(weights[[3, 7], 0], [2.0, -1.0], atol=0.01)


def test_isolability_tells_what_a_session_can_show():
    """Ploughing hides in the edge constants and looks like the size effect; runout and periodicity do not."""
    names = ("radial_runout", "size_effect", "ploughing", "material_periodicity")
    found = isolability.isolability("mill", 0, "medium", names)
    assert found["ploughing"]["survival"] < 0.2 and found["size_effect"]["survival"] < 0.35
    assert found["ploughing"]["nearest"] == "size_effect" and found["ploughing"]["cosine"] > 0.3
    assert found["radial_runout"]["survival"] > 0.8 and found["material_periodicity"]["survival"] > 0.95
    assert found["material_periodicity"]["cosine"] < 0.1
