"""The first look at every effect ranks the one put in first, and says what trials cannot show."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing.fitting.fit import base_starts, fit, reweighted
from mjx_cutting.tracing.fitting.problem import pose
from mjx_cutting.tracing.fitting.screening import screen
from mjx_cutting.tracing.records.lines import compress, trusted_band
from mjx_cutting.trials.synthetic import Hidden

KINDS = [effect_class(name) for name in ("radial_runout", "unequal_pitch", "size_effect", "side_friction")]


@pytest.fixture(scope="module")
def screened(mill):
    dataset = mill(Hidden(runout_m=6e-6, runout_angle_rad=0.7))
    with _platform.x64():
        problem = pose(dataset, compress(dataset, trusted_band(dataset, None)))
        problem = reweighted(problem, fit(problem, (), base_starts(problem)))
        base = fit(problem, (), base_starts(problem))
        return {each.kind.name: each for each in screen(problem, (), base.x, KINDS)}


def test_what_was_put_in_explains_nearly_everything(screened):
    assert next(iter(screened)) == "radial_runout"
    assert screened["radial_runout"].share > 0.98
    assert max(each.share for name, each in screened.items() if name != "radial_runout") < 0.5


def test_survival_tells_what_the_base_model_can_imitate(screened):
    """In slots of one depth with a bias a trial, friction on the engaged area is but a constant."""
    assert screened["side_friction"].survival < 0.05
    assert screened["radial_runout"].survival > 0.8
    assert screened["size_effect"].survival < screened["unequal_pitch"].survival


def test_directions_are_unit_vectors_and_cosines_tell_effects_apart(screened):
    first, second = screened["radial_runout"].direction, screened["unequal_pitch"].direction
    assert np.linalg.norm(first) == pytest.approx(1.0)
    assert abs(first @ second) < 0.8
