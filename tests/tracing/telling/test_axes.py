"""A sensor mounted another way round is noticed, and the key that would say so is given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.problem import pose
from mjx_cutting.tracing.records.lines import compress, trusted_band
from mjx_cutting.tracing.telling.axes import better_reading
from mjx_cutting.trials.dataset import columns_to_process
from mjx_cutting.trials.synthetic import Hidden


def _reading(dataset, left=1.0):
    with _platform.x64():
        lines = compress(dataset, trusted_band(dataset, None))
        return better_reading(dataset, lines, fit_base(pose(dataset, lines))[0], left)


@pytest.mark.parametrize("declared", [None, ("-z", "+x", "+y")])
def test_forces_on_the_sheet_along_other_axes_are_noticed(mill, declared):
    dataset = mill()
    turned = [
        replace(trial, force_n=columns_to_process(trial.force_n, ("+y", "-x", "+z")))
        for trial in dataset.trials
    ]
    found = _reading(replace(dataset, trials=tuple(turned), axes=declared))
    assert found is not None and found.error < 0.01 < 0.1 < found.now
    assert _reading(replace(dataset, trials=tuple(turned), axes=declared), left=0.05) is None
    columns = np.eye(3) if declared is None else columns_to_process(np.eye(3), declared).T
    for trial, other in zip(dataset.trials, turned, strict=True):
        file = other.force_n @ columns
        again = columns_to_process(file, found.axes)
        np.testing.assert_allclose(again[:, :2], trial.force_n[:, :2])


def test_forces_that_fit_as_they_are_are_left_alone(mill):
    assert _reading(mill(Hidden(runout_m=2e-5))) is None
