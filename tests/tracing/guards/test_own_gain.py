"""A factor that every trial has of its own is not to be taken for an effect that grows with something."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing.fitting.fit import effect_starts, fit_base
from mjx_cutting.tracing.fitting.heldout import folds
from mjx_cutting.tracing.guards import own_gain
from mjx_cutting.tracing.guards.gain import Gain
from mjx_cutting.tracing.guards.own_gain import rather_a_factor
from mjx_cutting.tracing.naming.candidate import fitted
from mjx_cutting.trials.synthetic import Hidden


@pytest.mark.parametrize(
    ("name", "hidden", "factors", "refused"),
    [
        ("flank_wear", Hidden(), [0.8, 1.1, 0.85, 1.2, 0.95, 1.3], True),
        ("radial_runout", Hidden(runout_m=1.2e-5), [0.8, 1.1, 1.3, 0.9, 1.2, 0.7], False),
        ("radial_runout", Hidden(runout_m=1.2e-5), [1.0] * 6, False),
    ],
)
def test_what_is_a_factor_of_each_trial_is_told_from_a_change_of_shape(
    mill, posed, name, hidden, factors, refused
):
    made = mill(hidden, seed=2)
    scaled = [replace(t, force_n=f * t.force_n) for t, f in zip(made.trials, factors, strict=True)]
    dataset = replace(made, trials=tuple(scaled))
    kind = effect_class(name)
    with _platform.x64():
        lines, problem = posed(dataset)
        problem, base = fit_base(problem)
        start = effect_starts(problem, kind, base.x)[0]
        found, _ = fitted(problem, lines, (kind,), np.asarray(start), folds(dataset, 0))
        why = rather_a_factor(Gain(problem, lines, (kind,), base, found))
    assert (why is not None) == refused


# what the base model leaves, and with a factor a trial; the same beside the effect
@pytest.mark.parametrize(
    ("name", "alone", "beside", "refused"),
    [
        ("robot_mode", (100.0, 30.0), (30.0, 31.0), "spindle's speeds alone"),
        ("robot_mode", (100.0, 12.0), (2.0, 2.0), None),
        ("robot_mode", (100.0, 2.5), (2.0, 2.0), "spindle's speeds alone"),
        ("robot_mode", (100.0, 30.0), (30.0, 10.0), None),
        ("flank_wear", (100.0, 30.0), (30.0, 31.0), None),
        ("robot_mode", (100.0, 30.0), (80.0, 31.0), "3.5 times as much"),
        ("flank_wear", (100.0, 65.0), (60.0, 50.0), "explains 41% of what is missing"),
        ("flank_wear", (100.0, 65.0), (60.0, 40.0), None),
        ("flank_wear", (100.0, 35.0), (30.0, 25.0), None),
    ],
)
def test_what_a_gain_of_each_trial_could_do_is_refused_where_it_does_no_more_or_leaves_most(
    monkeypatch, mill, posed, name, alone, beside, refused
):
    """Of a hundred, two of them noise: left by a factor a trial alone, by the effect alone, and by both."""
    kind = effect_class(name)
    why = _asked(monkeypatch, mill, posed, kind, (*alone, 1e4), (*beside, 1e4))
    assert why is None if refused is None else refused in why


@pytest.mark.parametrize(
    ("force", "trials", "beside", "refused"),
    [
        (1e6, 20, 2.0, None),
        (1e6, 9, 2.0, "1.1 times"),
        (1e4, 20, 2.0, "1.1 times as much"),
        (1e6, 20, 13.0, "1.1 times"),
    ],
)
def test_cuts_not_quite_alike_do_not_speak_against_an_effect(
    monkeypatch, mill, posed, force, trials, beside, refused
):
    """Of a hundred the effect explains 86, and a factor a trial 97: what they differ by beside the effect is
    .3 % of a large force, or 3.5 % of a small one. Of nine trials three unknowns follow so much by chance.
    A shape that is not there leaves more beside the factors."""
    kind = effect_class("flank_wear")
    why = _asked(monkeypatch, mill, posed, kind, (100.0, 3.0, force), (14.0, beside, force), trials)
    assert why is None if refused is None else refused in why


def _asked(monkeypatch, mill, posed, kind, alone, beside, trials=6):
    """Why an effect is refused that leaves so much of so many trials."""
    monkeypatch.setattr(own_gain, "_squares", lambda problem, effects, x: beside if effects else alone)
    monkeypatch.setattr(own_gain, "noise_squares", lambda problem, lines: np.full((1, 2, 1), 1.0))
    monkeypatch.setattr(own_gain, "tolerated", lambda problem, lines: 1.0)
    with _platform.x64():
        lines, problem = posed(mill())
        problem = SimpleNamespace(tool=problem.tool, trials=trials)
        fit = SimpleNamespace(x=np.zeros(1))
        return rather_a_factor(Gain(problem, lines, (kind,), fit, fit))
