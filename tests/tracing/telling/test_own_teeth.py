"""Teeth that are not quite alike are scatter, as sheets are; teeth that clearly differ are not."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.fitting.prediction import predictions
from mjx_cutting.tracing.guards.unlike_teeth import UnlikeTeeth
from mjx_cutting.tracing.telling.dependence import dependences
from mjx_cutting.tracing.telling.own_teeth import own_teeth
from mjx_cutting.trials.synthetic import Hidden

SHAPE = np.array([0.9, -1.3, 0.8, -0.4])
SHAPE = SHAPE / np.sqrt(np.mean(SHAPE**2))


@pytest.fixture(scope="module")
def base(mill):
    """What a trace without candidates makes of slots of a tool that lacks nothing."""
    return trace(mill(), effects=())


def _cut_by(found, size: float):
    """The trials of a tracing as cut by teeth with shares of force of their own."""
    with _platform.x64():
        problem, model = found.search.problem, found.search.final_fit.model
        teeth = model.with_effects(UnlikeTeeth(jnp.asarray(size * SHAPE)))
        apart, alike = (predictions(found.dataset, found.lines, problem, each) for each in (teeth, model))
    more = iter(one.predicted_n - other.predicted_n for one, other in zip(apart, alike, strict=True))
    trials = (
        replace(each, force_n=each.force_n + next(more)) if each.kind == "cut" else each
        for each in found.dataset.trials
    )
    return replace(found.dataset, trials=tuple(trials))


def _told(found):
    with _platform.x64():
        return own_teeth(found.dataset, found.lines, found.search, found.after)


def test_teeth_that_are_alike_have_no_shares_of_their_own(base):
    assert base.verdict["verdict"] == "nothing missing"
    assert _told(base) is None


def test_small_shares_are_told_and_leave_nothing_that_repeats_with_the_turns(base):
    found = trace(_cut_by(base, 0.01), effects=())
    own = _told(found)
    assert own is not None
    assert own.size == pytest.approx(0.01, rel=0.1)
    teeth, orders = found.dataset.tool.teeth, found.lines.orders
    bare, less = (
        {each.covariate for each in dependences(found.dataset, some, teeth, orders) if each.found}
        for some in (found.after, own.without)
    )
    assert "spindle order" in bare - less
    assert found.verdict["verdict"] == "nothing missing"
    assert (
        "force of each tooth is larger or smaller as a whole, by 1.0%"
        in found.verdict["remaining"]["description"]
    )


def test_large_shares_ask_for_a_cause(base):
    found = trace(_cut_by(base, 0.05), effects=())
    assert _told(found) is None
    assert found.verdict["verdict"] == "unexplained"
    assert "spindle order" in found.verdict["remaining"]["depends_on"]


@pytest.mark.slow
def test_a_runout_is_named_though_teeth_are_not_alike(mill):
    tried = ("radial_runout", "unequal_pitch", "size_effect")
    runs_out = trace(mill(Hidden(runout_m=1.2e-5, runout_angle_rad=0.7)), effects=tried)
    found = trace(_cut_by(runs_out, 0.01), effects=tried).verdict
    assert [each["name"] for each in found["effects"]] == ["radial_runout"]
    assert found["verdict"] == "explained"
