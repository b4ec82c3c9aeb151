"""The forces of a turning tool are read in the axes of its base law, whichever column each is in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.records.levels import as_levels
from mjx_cutting.tracing.telling.axes import other_columns
from mjx_cutting.trials.dataset import process_to_columns


@pytest.mark.parametrize(
    ("columns", "signs"), [([0, 1, 2], [1, 1, 1]), ([0, 2, 1], [1, 1, 1]), ([1, 0, 2], [-1, -1, 1])]
)
def test_the_largest_force_on_a_turning_tool_is_the_main_one_whichever_column_it_is_in(columns, signs):
    made = make("turning", {"size_effect": "strong"}, 402).dataset
    turned = replace(
        made, trials=tuple(replace(t, force_n=signs * t.force_n[:, columns]) for t in made.trials)
    )
    read = as_levels(turned)
    for trial, expected in zip(read.trials, as_levels(made).trials, strict=True):
        np.testing.assert_allclose(trial.force_n, expected.force_n)
        recorded = process_to_columns(trial.force_n, read.axes)
        np.testing.assert_allclose(recorded, signs * expected.force_n[:, columns])
    assert (read.axes is None) == (columns == [0, 1, 2])
    assert (other_columns(read, turned.axes) is None) == (read.axes is None)


def test_a_tracing_tells_how_it_read_the_columns():
    made = make("turning", {"size_effect": "strong"}, 402).dataset
    turned = replace(made, trials=tuple(replace(t, force_n=t.force_n[:, [0, 2, 1]]) for t in made.trials))
    read, plain = (trace(each, effects=("size_effect",)) for each in (turned, made))
    assert [each["name"] for each in read.verdict["effects"]] == ["size_effect"]
    assert read.verdict["after"]["heldout_nrmse"] == pytest.approx(plain.verdict["after"]["heldout_nrmse"])
    told = "read as ['+x', '+z', '+y']"
    assert any(told in each for each in read.caveats) and told in read.verdict["remaining"]["description"]
    assert not any("read as" in each for each in plain.caveats)
