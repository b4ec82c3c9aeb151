"""What goes with a condition and has no name: a factor is fitted, added to the model, and never named."""

from __future__ import annotations

import json

import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting.cutting import Cut, ForceModel, Material, Tool
from mjx_cutting.cutting.effects.unnamed_gain import CONDITIONS, UnnamedGain
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.along.predicted import predict_trials
from mjx_cutting.tracing.trace import save


def over(condition: str, knots: tuple[float, ...], gain: tuple[float, ...]) -> UnnamedGain:
    places, values = np.zeros((6, 3)), np.zeros((6, 2))
    index = CONDITIONS.index(condition)
    places[index], values[index] = knots, gain
    return UnnamedGain(values.ravel(), places.ravel())


@pytest.mark.parametrize(
    "speed, factor",
    [(5.0, 1.0), (10.0, 1.0), (15.0, 1.1), (20.0, 1.2), (30.0, 0.8), (40.0, 0.4), (90.0, 0.4)],
)
def test_the_factor_is_straight_between_knots_and_constant_beyond(speed, factor):
    effect = over("spindle speed", (10.0, 20.0, 40.0), (0.2, -0.6))
    cut = Cut.milling(
        "slot",
        0.016,
        angle_rad=jnp.linspace(0.0, 6.0, 40),
        spindle_speed_rev_s=speed,
        feed_speed_m_s=0.01,
        radial_depth_m=0.016,
        axial_width_m=0.002,
    )
    bare = ForceModel(Tool("end_mill", 4, 0.016), Material(8e8, 2e4, 2.4e8, 1.6e4, 1e8, 4e3))
    force = bare.with_effects(effect).process_force(cut)
    np.testing.assert_allclose(force, factor * bare.process_force(cut), rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize(
    "cause, conditions",
    [
        ("speed_softening", ("spindle speed",)),
        ("feed_speed_cross", ("feed", "spindle speed", "feed with spindle speed")),
    ],
)
def test_a_law_nobody_modelled_is_fitted_and_left_unnamed(cause, conditions, tmp_path):
    case = make("turning", {cause: "strong"}, 311)
    found = trace(case.dataset, effects=("flank_wear", "size_effect", "ploughing"))
    verdict = found.verdict
    assert verdict["verdict"] == "unexplained" and verdict["effects"] == []
    assert verdict["after"]["heldout_nrmse"] == verdict["before"]["heldout_nrmse"]
    assert found.unnamed is not None and found.unnamed.over == conditions
    assert found.unnamed.after.nrmse < 0.3 * verdict["before"]["heldout_nrmse"]
    assert "unnamed factor" in verdict["remaining"]["description"]
    assert any("unnamed factor" in each for each in found.caveats)
    save(found, tmp_path)
    model = ForceModel.from_dict(json.loads((tmp_path / "model.json").read_text()))
    assert [type(each) for each in model.effects] == [UnnamedGain]
    left, bare = (predict_trials(case.dataset, each) for each in (model, found.base_model))
    error, without = (sum(float(np.sum(p.residual_n**2)) for p in each) for each in (left, bare))
    assert error < 0.1 * without


def test_nothing_unnamed_is_added_where_a_name_explains_it():
    case = make("turning", {"size_effect": "medium"}, 311)
    found = trace(case.dataset, effects=("flank_wear", "size_effect", "ploughing"))
    assert [each["name"] for each in found.verdict["effects"]] == ["size_effect"]
    assert found.unnamed is None and "unnamed" not in found.verdict["remaining"]["description"]


def test_it_is_never_looked_for_by_name_or_listed_as_untestable():
    found = trace(make("turning", {}, 311).dataset, effects=("size_effect",))
    assert "unnamed_gain" not in {each["name"] for each in found.verdict["not_testable"]}
