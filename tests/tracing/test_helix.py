"""A helix that is not the stated one: the lines are those of the sum of both, not of one upon the other."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting.cutting import ForceModel, Material, Tool, effect_class
from mjx_cutting.tracing.fitting.model_lines import model_lines
from mjx_cutting.tracing.trace import trace

HELIX = effect_class("helix_lag")


@pytest.fixture
def lines(mill, posed):
    """Call it with the angle that the data set states, and effects."""

    def of(stated_rad: float, *effects):
        dataset = mill()
        dataset = replace(dataset, tool=replace(dataset.tool, helix_rad=stated_rad))
        with jax.enable_x64(True):
            problem = posed(dataset)[1]
            material = Material(8e8, 2e4, 2.4e8, 1.6e4, 1.2e8, 4e3)
            return np.asarray(model_lines(problem, ForceModel(problem.tool, material, effects)))

    return of


@pytest.mark.parametrize("more_rad", [0.2, -0.2, -0.5])
def test_a_correction_is_added_to_the_stated_angle(lines, more_rad):
    true = lines(0.5 + more_rad)
    np.testing.assert_allclose(lines(0.5, HELIX(more_rad)), true, atol=1e-9 * np.abs(true).max())
    assert np.abs(lines(0.5) - true).max() > 1e-3 * np.abs(true).max()


def test_of_teeth_said_to_be_straight_a_right_hand_helix_is_supposed():
    """The other hand leaves the same lines at another phase, which no trial knows."""
    assert (HELIX.starts(Tool("end_mill", 4, 0.016)) > 0.0).all()
    assert {-1.0, 1.0} == set(np.sign(HELIX.starts(Tool("end_mill", 4, 0.016, 0.5))).ravel())


@pytest.mark.slow
def test_less_helix_than_stated_is_named_with_its_size():
    case = make("mill", {"helix_lag": "medium"}, seed=403)
    found = trace(case.dataset, effects=["helix_lag", "sensor_lowpass", "sensor_resonance", "size_effect"])
    (said,) = found.verdict["effects"]
    true = case.truth["effects"]["helix_lag"]["helix_rad"]
    assert said["name"] == "helix_lag" and true == pytest.approx(-0.2)
    assert said["parameters"]["helix_rad"]["value"] == pytest.approx(true, abs=0.02)
    assert found.verdict["verdict"] == "explained"
