"""The trial that tells two explanations apart."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.cutting import ForceModel, effect_class
from mjx_cutting.tracing.fitting.fit import base_starts, fit
from mjx_cutting.tracing.fitting.problem import pose, shared_bias
from mjx_cutting.tracing.records.lines import compress, trusted_band
from mjx_cutting.tracing.telling.separation import separations


@pytest.fixture(scope="module")
def posed(mill):
    with _platform.x64():
        dataset = mill(seed=1)
        lines = compress(dataset, trusted_band(dataset, None))
        problem = pose(dataset, lines)
        found = fit(problem, (), base_starts(problem))
        yield dataset, lines, problem, found.model, np.asarray(shared_bias(problem, found.x))


def apart(posed, first, second):
    dataset, lines, problem, model, bias = posed
    models = [ForceModel(model.tool, model.material, (each,)) for each in (first, second)]
    return {each.trial: each.sigma for each in separations(dataset, lines, problem, *models, (bias, bias))}


def test_a_model_is_not_apart_from_itself(posed):
    runout = effect_class("radial_runout")(1e-5, 0.3)
    assert max(apart(posed, runout, runout).values()) < 1e-3


def test_distance_grows_with_the_effect_and_the_best_comes_first(posed):
    kind, none = effect_class("radial_runout"), effect_class("radial_runout")(0.0, 0.3)
    small, large = (apart(posed, kind(size, 0.3), none) for size in (5e-7, 1e-6))
    for name in small:
        if "air" not in name:
            assert large[name] == pytest.approx(2.0 * small[name], rel=0.2)
    assert list(large.values()) == sorted(large.values(), reverse=True)


def test_in_air_only_what_needs_no_cutting_shows(posed):
    unbalance, runout = effect_class("unbalance")(5e-5, 0.3), effect_class("radial_runout")(1e-5, 0.3)
    told = apart(posed, unbalance, runout)
    in_air = next(sigma for name, sigma in told.items() if "in air" in name)
    assert in_air > 5.0
    alone = apart(posed, runout, effect_class("radial_runout")(0.0, 0.3))
    assert next(sigma for name, sigma in alone.items() if "in air" in name) < 1e-3


def test_trials_are_named(posed):
    files = {trial.file for trial in posed[0].trials}
    runout = effect_class("radial_runout")
    for name in apart(posed, runout(1e-5, 0.3), runout(0.0, 0.0)):
        assert any(name.startswith(f"{file} again") for file in files)
