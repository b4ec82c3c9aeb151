"""The force that effects along a trial are shares of counts only where its size is known."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.tracing.records.course import Course, along_path
from mjx_cutting.tracing.records.part import part_of
from mjx_cutting.trials.dataset import Trial

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


@pytest.fixture
def on_a_way(turning_cut):
    """Call it with places [T] on the first axis, m."""

    def make(place) -> Trial:
        position = np.stack([place, 0.0 * place, 0.0 * place], axis=1)
        return turning_cut(0.01 * np.arange(len(place)), np.ones((len(place), 3)), position_m=position)

    return make


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_tool_withdrawn_beyond_its_start_still_went_forward(on_a_way, sign):
    """It cuts for 70 samples and is driven back two and a half times as fast; a sampled position trembles."""
    way = np.concatenate([np.linspace(0.0, 2.8e-3, 70), np.linspace(2.8e-3, -2e-4, 30)])
    way = way + np.random.default_rng(0).normal(0.0, 1e-6, len(way))
    np.testing.assert_array_equal(along_path(on_a_way(0.1 + sign * way)), sign * (0.1 + sign * way))


def test_a_tool_that_waits_before_it_feeds_goes_forward(on_a_way):
    way = np.concatenate([np.zeros(80), np.linspace(0.0, -1e-3, 20)])
    np.testing.assert_array_equal(along_path(on_a_way(way)), -way)


def test_what_is_driven_back_adds_nothing_to_the_length_cut(on_a_way):
    way = np.concatenate([np.linspace(0.0, 2e-3, 70), np.linspace(2e-3, -1e-3, 30)])
    trial = on_a_way(way)
    assert part_of(trial, way, slice(35, 60)).cut_length_before_m == pytest.approx(way[35])
    assert part_of(trial, way, slice(98, 100)).cut_length_before_m == 0.0


def test_the_noise_of_an_encoder_is_no_motion(on_a_way):
    """Places about a sample's feed off; of an even feed."""
    way = 8e-6 * np.arange(2000)
    measured = way + np.random.default_rng(1).normal(0.0, 5e-6, len(way))
    np.testing.assert_allclose(along_path(on_a_way(measured)), way, atol=1e-6)


def test_a_feed_that_is_uneven_is_kept_beside_the_noise(on_a_way):
    way = 8e-6 * np.arange(2000) + 1e-5 * np.sin(0.05 * np.arange(2000))
    measured = way + np.random.default_rng(1).normal(0.0, 5e-6, len(way))
    np.testing.assert_array_equal(along_path(on_a_way(measured)), measured)
