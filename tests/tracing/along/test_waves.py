"""The force that effects along a trial act on: the chip's, the edge's, and how sure the fits are of it."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.cutting import ForceModel, Material, Tool
from mjx_cutting.cutting.effects import FlankWear, MaterialPeriodicity, SideFriction, Unbalance
from mjx_cutting.tracing.along.at_teeth import AtTeeth
from mjx_cutting.tracing.along.waves import _chip_and_edge, courses
from mjx_cutting.tracing.fitting.model_lines import model_lines
from mjx_cutting.tracing.fitting.prediction import predictions

CHIP, EDGE = (8e8, 2.4e8, 1.2e8), (2e4, 1.6e4, 4e3)
WEAR = FlankWear(np.array([3e8, 6e8, 2e8]), rate=1e-3)


def _model(chip, edge, *effects) -> ForceModel:
    (tc, rc, ac), (te, re, ae) = chip, edge
    return ForceModel(Tool("end_mill", 4, 0.016), Material(tc, te, rc, re, ac, ae), effects)


@pytest.fixture(scope="module")
def seen(mill, posed):
    """Call it with a model, and with those of the folds: the courses of six slots."""
    with jax.enable_x64(True):
        dataset = mill()
        lines, problem = posed(dataset)

        def look(model, *folds):
            each = [jax.tree.map(np.asarray, fold) for fold in folds or (model,)]
            stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *each)
            after = predictions(dataset, lines, problem, model)
            return courses(dataset, lines, problem, model, after, stacked)

        yield look


def test_chip_and_edge_are_the_whole_force_and_each_its_own(seen):
    none = (0.0, 0.0, 0.0)
    whole, chip, edge = (seen(_model(*each)) for each in ((CHIP, EDGE), (CHIP, none), (none, EDGE)))
    for one, of_chip, of_edge in zip(whole, chip, edge, strict=True):
        size = np.abs(one.chip_n).max()
        assert size > 10.0
        np.testing.assert_allclose(of_edge.chip_n, 0.0, atol=1e-9 * size)
        np.testing.assert_allclose(of_chip.edge_n, 0.0, atol=1e-9 * size)
        np.testing.assert_allclose(
            np.std(one.chip_n, axis=0), np.std(of_chip.chip_n, axis=0), rtol=1e-2, atol=1e-2 * size
        )


def test_the_force_on_a_worn_land_is_of_the_edge(seen):
    """A sheet whose chips resist more in places does not press harder on the land there."""
    worn, sharp = seen(_model(CHIP, EDGE, WEAR)), seen(_model(CHIP, EDGE))
    for one, other in zip(worn, sharp, strict=True):
        chip, same = (np.sort(each.chip_n, axis=0) for each in (one, other))
        np.testing.assert_allclose(chip, same, atol=0.02 * np.abs(same).max())
    assert np.abs(worn[-1].edge_n).max() > 1.05 * np.abs(sharp[-1].edge_n).max()


def test_folds_tell_how_sure_either_force_is(seen):
    folds = [
        _model(np.multiply(CHIP, more), np.multiply(EDGE, less)) for more, less in ((1.1, 1.0), (0.9, 0.8))
    ]
    for each in seen(_model(CHIP, EDGE), *folds):
        np.testing.assert_allclose(each.chip_by_fold, [[1.1] * 3, [0.9] * 3], rtol=1e-6)
        np.testing.assert_allclose(each.edge_by_fold, [[1.0] * 3, [0.8] * 3], rtol=1e-6)
        np.testing.assert_allclose(each.without(1).chip_n, 0.9 * each.chip_n)


@pytest.mark.parametrize("wavelength_m", [2e-3, 6e-3])
def test_lines_at_teeth_are_those_of_a_pattern_met_by_them(mill, posed, wavelength_m):
    """At any place of the centre: lines on a periodic sheet are those on an even one, and these turned."""
    wave_rad_m, place_m, phase = 2.0 * np.pi / wavelength_m, 3.1e-3, 0.7
    with jax.enable_x64(True):
        _, problem = posed(mill())
        model = _model(CHIP, EDGE)
        teeth = AtTeeth(problem, model, _chip_and_edge)
        here = replace(problem, cut=problem.cut.replace(position_m=jnp.full(problem.trials, place_m)))
        pattern = MaterialPeriodicity(0.3, wavelength_m, phase, 0.4, tooth_place=1.0)
        fine = replace(here, arc_rad=3.0 * here.arc_rad)
        expected = np.asarray(model_lines(fine, model.with_effects(pattern)) - model_lines(fine, model))
        cosine, sine = teeth.lines(wave_rad_m)
    turn = wave_rad_m * (place_m + 0.5 * sum(teeth.ahead_m)) + phase
    of_chip, of_edge = np.cos(turn) * cosine - np.sin(turn) * sine
    found = 0.3 * (of_chip + 0.4 * of_edge)
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
    assert np.abs(expected).max() > 0.1


def test_a_wave_longer_than_the_arc_is_met_by_all_teeth_at_once(seen):
    for each in seen(_model(CHIP, EDGE)):
        found = each.at_teeth([1e-3])[0]
        for turned, whole in zip(found, (each.chip_n, each.edge_n), strict=True):
            np.testing.assert_allclose(turned, whole, atol=1e-4 * np.abs(whole).max())


def test_directions_are_the_whole_force_and_each_its_own(seen):
    """What a worn land adds is of the direction it presses in."""
    (tc, *_), (te, *_) = CHIP, EDGE
    both = (seen(_model(CHIP, EDGE)), seen(_model(CHIP, EDGE, WEAR)))
    for one in (*both[0], *both[1]):
        whole = one.chip_n + one.edge_n
        found = one.force_by_direction()
        np.testing.assert_allclose(found.sum(axis=-1), whole, atol=1e-6 * np.abs(whole).max())
        np.testing.assert_allclose(found[:, 2, :2], 0.0, atol=1e-9 * np.abs(whole).max())
    for one, tangential in zip(both[0], seen(_model((tc, 0.0, 0.0), (te, 0.0, 0.0))), strict=True):
        expected = np.std(tangential.chip_n + tangential.edge_n, axis=0)
        found = np.std(one.force_by_direction()[..., 0], axis=0)
        np.testing.assert_allclose(found, expected, rtol=1e-2, atol=1e-2 * expected.max())


def test_what_is_not_of_the_teeth_is_of_neither_chip_nor_edge_nor_direction(seen):
    """A balance that is off, and what rubs on the sides, do not press harder where a sheet is harder."""
    beside = (Unbalance(2e-4, 0.7), SideFriction(2e4))
    for one, other in zip(seen(_model(CHIP, EDGE)), seen(_model(CHIP, EDGE, *beside)), strict=True):
        for alone, found in (
            (one.chip_n, other.chip_n),
            (one.edge_n, other.edge_n),
            (one.force_by_direction(), other.force_by_direction()),
        ):
            size = np.abs(alone).max()
            expected, found = np.sort(alone, axis=0), np.sort(found, axis=0)
            np.testing.assert_allclose(found, expected, atol=0.02 * size)


def test_directions_are_held_to_the_folds_as_the_force_is(seen):
    folds = [_model(np.multiply(CHIP, share), np.multiply(EDGE, share)) for share in (1.1, 0.9)]
    for each in seen(_model(CHIP, EDGE), *folds):
        np.testing.assert_allclose(
            each.without(1).force_by_direction(), 0.9 * each.force_by_direction(), rtol=1e-6
        )
