"""What a model says of measured trials holds what it has along them, not only its lines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.study import make
from benchmarks.study.generator import Case
from mjx_cutting.cutting import ForceModel, Material, Tool, effect_class
from mjx_cutting.tracing import predict_trials
from mjx_cutting.tracing.along.kind import as_values
from mjx_cutting.tracing.along.slow_kinds import KINDS, kind_of

ALONG = (
    "layered_material", "material_periodicity", "mains_pickup", "command_stair", "hysteresis", "entry_exit",
    "process_damping",
)  # fmt: skip


def _true(case: Case) -> ForceModel:
    """The model that the session was made with, by code of its own."""
    tool = case.dataset.tool
    kinds = {name: effect_class(name) for name in case.truth["effects"]}
    effects = [
        kinds[name](**{key: value for key, value in values.items() if key in kinds[name].parameters})
        for name, values in case.truth["effects"].items()
    ]
    return ForceModel(
        Tool(tool.kind, tool.teeth, tool.diameter_m, tool.helix_rad),
        Material(**case.truth["material"]),
        tuple(effects),
    )


def _few(case: Case) -> Case:
    return replace(case, dataset=replace(case.dataset, trials=case.dataset.trials[:4]))


def _left(case: Case, model: ForceModel) -> float:
    """Root mean square of what a model leaves, N."""
    return float(np.sqrt(np.mean([np.mean(t.residual_n**2) for t in predict_trials(case.dataset, model)])))


@pytest.mark.parametrize(
    ("design", "name", "seed"), [*(("mill", each, 45) for each in ALONG), ("drill", "mains_pickup", 47)]
)
def test_the_true_model_leaves_what_a_session_without_the_effect_leaves(design, name, seed):
    """Not what the lines alone leave; and of a channel that nothing is recorded on, nothing is said."""
    case, nothing = make(design, {name: "strong"}, seed), make(design, {}, seed)
    model = _true(case)
    least = _left(nothing, replace(model, effects=()))
    alone = _left(case, replace(model, effects=()))
    assert alone > 1.5 * least
    assert _left(case, model) < least + 0.1 * (alone - least)


def test_effects_along_the_trial_are_predicted_beside_each_other_and_beside_steady_ones():
    hidden = {"radial_runout": "medium", "layered_material": "medium", "mains_pickup": "medium"}
    case, nothing = _few(make("saw", hidden, 46)), _few(make("saw", {}, 46))
    model = _true(case)
    least = _left(nothing, replace(model, effects=()))
    without = [_left(case, replace(model, effects=tuple(e for e in model.effects if e is not one)))
               for one in model.effects]  # fmt: skip
    whole = _left(case, model)
    assert whole < 1.2 * least and all(whole < 0.9 * each for each in without)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_an_effect_is_made_again_from_its_parts(kind):
    case = make("mill", {kind.name: "strong"}, 45)
    (effect,) = _true(case).effects
    own = kind_of(effect)
    again = as_values(own.build(*own.parts(effect)))
    for name, value in as_values(effect).items():
        if name != "stiction":  # tracing does not tell it
            np.testing.assert_allclose(again[name], value, rtol=1e-9, atol=1e-12, err_msg=name)


def test_a_stair_without_a_measured_feed_is_refused():
    case = make("mill", {"command_stair": "medium"}, 45)
    trials = tuple(replace(each, feed_speed_measured_m_s=None) for each in case.dataset.trials)
    with pytest.raises(ValueError, match=r"command_stair.*no measured feed.*expected one in every cut"):
        predict_trials(replace(case.dataset, trials=trials), _true(case))
