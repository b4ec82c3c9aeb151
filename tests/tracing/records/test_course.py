"""The force that effects along a trial are shares of counts only where its size is known."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.tracing.records.course import Course

TIME = np.arange(100) / 500.0


@pytest.mark.parametrize(("edge_share", "known"), [(0.0, [True, False, True]), (1.0, [True, True, True])])
def test_a_wave_of_either_sign_is_left_out_unless_more_of_it_is_known(edge_share, known):
    """The fits without a fold agree on the edge, not on the chip's force along y."""
    chip = np.tile([3.0, 0.1, 1.0], (100, 1))
    edge = np.full_like(chip, 2.0)
    chip_by_fold = np.stack([[1.01, 1.9, 1.0], [0.99, -0.2, 1.02], [1.0, 1.3, 0.98]])
    course = Course(
        TIME,
        0.01 * TIME,
        None,
        chip,
        edge,
        0.0 * chip,
        500.0,
        (0.0, 200.0),
        chip_by_fold=chip_by_fold,
        edge_by_fold=np.ones((3, 3)),
    )
    whole = chip + edge_share * edge
    np.testing.assert_array_equal(course.force(edge_share), np.where(known, whole, 0.0))


def test_without_folds_all_is_taken_as_known():
    chip = np.ones((100, 3))
    course = Course(TIME, TIME, None, chip, 2.0 * chip, chip, 500.0, (0.0, 200.0))
    np.testing.assert_array_equal(course.force(0.5), 2.0 * chip)
