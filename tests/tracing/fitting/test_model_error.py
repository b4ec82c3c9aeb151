"""How far the tolerated error of a model moves its parameters."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import base_starts, effect_starts, fit
from mjx_cutting.tracing.fitting.heldout import folds
from mjx_cutting.tracing.fitting.model_error import model_errors, tolerated
from mjx_cutting.tracing.fitting.problem import pose
from mjx_cutting.tracing.naming.candidate import fitted
from mjx_cutting.tracing.records.lines import compress, trusted_band
from mjx_cutting.trials.synthetic import Hidden

RUNOUT = effect_class("radial_runout")


@pytest.fixture(scope="module")
def session(mill):
    with _platform.x64():
        dataset = mill(Hidden(runout_m=1.2e-5, runout_angle_rad=0.7), seed=2)
        lines = compress(dataset, trusted_band(dataset, None))
        problem = pose(dataset, lines)
        base = fit(problem, (), base_starts(problem))
        start = effect_starts(problem, RUNOUT, base.x)[0]
        found, _ = fitted(problem, lines, (RUNOUT,), start, folds(dataset, 0))
        yield problem, lines, found


def test_no_smaller_change_of_the_model_moves_a_parameter_as_far(session):
    """Whatever the other unknowns do, a runout off by the error told changes the lines by the tolerance.

    A tenth of it is tried: a tooth that leaves the sheet bends what is straight near the fit.
    """
    problem, lines, found = session
    error = 0.1 * float(model_errors(problem, lines, (RUNOUT,), found.x)[0].by_name["offset_m"])
    x = np.asarray(found.x)
    longer = np.concatenate([x[:-2], x[-2:] * (1.0 + error / float(found.model.effects[0].offset_m))])
    descent = Descent(problem, (RUNOUT,))
    here, moved = descent.rows(np.stack([x, longer])).left
    slope, change = descent.around(x)[1][: descent.measured], (moved - here)[: descent.measured]
    turned = slope[:, -2:] @ np.array([-x[-1], x[-2]])
    others = np.column_stack([slope[:, :-2], turned])
    left = change - others @ np.linalg.lstsq(others, change, rcond=None)[0]
    assert np.linalg.norm(left) == pytest.approx(0.1 * tolerated(problem, lines), rel=0.1)


def test_error_is_a_small_part_of_a_large_effect(session):
    problem, lines, found = session
    error = 0.1 * float(model_errors(problem, lines, (RUNOUT,), found.x)[0].by_name["offset_m"])
    assert 1e-4 < error / 1.2e-5 < 0.2


def test_strength_in_multiples_of_the_error(session):
    """With the angle held, so many tolerated errors as |scale s| undo the runout."""
    problem, lines, found = session
    (moved,) = model_errors(problem, lines, (RUNOUT,), found.x)
    size = float(found.model.effects[0].offset_m)
    assert moved.scale.shape == (1, 1)
    assert 1.0 <= float(moved.scale[0, 0] * moved.by_name["offset_m"]) < 1.5
    assert float(moved.scale[0, 0]) * size > 5.0
