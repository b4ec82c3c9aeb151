"""The base model's constants, and an effect's size, come back from trials made apart from the force path."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
import pytest

from mjx_cutting.cutting.effects import RadialRunout
from mjx_cutting.tracing.fitting.fit import base_starts, effect_starts, fit, freedom, reweighted, spread
from mjx_cutting.tracing.fitting.heldout import folds, held_out
from mjx_cutting.tracing.fitting.model_lines import model_lines
from mjx_cutting.tracing.fitting.problem import out_of_range, pose
from mjx_cutting.tracing.fitting.residual import residual_of_lines
from mjx_cutting.tracing.records.lines import compress, trusted_band
from mjx_cutting.trials.synthetic import Hidden


@pytest.fixture(scope="module")
def clean(mill, posed):
    with jax.enable_x64(True):
        dataset = mill()
        lines, problem = posed(dataset)
        problem = reweighted(problem, fit(problem, (), base_starts(problem)))
        yield dataset, lines, problem, fit(problem, (), base_starts(problem))


def test_constants_come_back(clean, mill_sheet):
    *_, found = clean
    material = found.model.material
    np.testing.assert_allclose(material.chip_n_m2, mill_sheet.chip_n_m2, rtol=0.02)
    np.testing.assert_allclose(material.edge_n_m, mill_sheet.edge_n_m, rtol=0.05)


def test_what_is_left_is_the_noise(clean):
    dataset, lines, problem, found = clean
    assert spread(problem, found) == pytest.approx(1.0, abs=0.05)
    assert freedom(problem, found) > 100
    error = held_out(problem, lines, (), found.x, folds(dataset, 0))
    noise = np.sqrt(lines.rest_n2.sum() / lines.energy_n2.sum())
    assert error.nrmse == pytest.approx(noise, rel=0.25)


def test_error_by_lines_equals_error_by_samples(clean):
    from mjx_cutting.tracing.fitting.prediction import predictions

    dataset, lines, problem, found = clean
    by_samples = [np.sum(p.residual_n**2) for p in predictions(dataset, lines, problem, found.model)]
    by_lines = found.error_n2.sum(axis=1) + lines.rest_n2.sum(axis=1)
    np.testing.assert_allclose(by_samples, by_lines, rtol=1e-3)


def test_residual_does_not_depend_on_where_a_trial_begins(clean):
    dataset, _, problem, found = clean
    later = [
        dataclasses.replace(trial, time_s=trial.time_s[:-700], force_n=trial.force_n[700:])
        for trial in dataset.trials
    ]
    moved = dataclasses.replace(dataset, trials=tuple(later))
    lines = compress(moved, trusted_band(moved, None))
    problems = pose(moved, lines), problem
    again, whole = (residual_of_lines(each, model_lines(each, found.model)) for each in problems)
    per_sample = np.sqrt(np.asarray(again.remaining_n**2).sum() / lines.samples.sum())
    before = np.sqrt(np.asarray(whole.remaining_n**2).sum() / (lines.samples + 700).sum())
    assert per_sample == pytest.approx(before, rel=0.3)


def test_range_is_zero_inside_and_grows_outside(clean):
    _, _, problem, found = clean
    inside = out_of_range(problem, np.concatenate([found.x, [0.3, 0.0]]), (RadialRunout,))
    outside = out_of_range(problem, np.concatenate([found.x, [15.0, 0.0]]), (RadialRunout,))
    assert not np.any(inside)
    assert np.max(outside) == pytest.approx(0.5, abs=1e-6)


def test_runout_comes_back_with_its_direction(mill):
    with jax.enable_x64(True):
        dataset = mill(Hidden(runout_m=6e-6, runout_angle_rad=0.7))
        lines = compress(dataset, trusted_band(dataset, None))
        problem = pose(dataset, lines)
        base = fit(problem, (), base_starts(problem))
        found = fit(problem, (RadialRunout,), effect_starts(problem, RadialRunout, base.x))
        runout = found.model.effects[0]
        assert float(runout.offset_m) == pytest.approx(6e-6, rel=0.03)
        # the direction is known modulo a tooth, because the phase of a trial is free
        apart = (float(runout.angle_rad) - 0.7) / (2 * np.pi / 4)
        assert abs(apart - round(apart)) < 0.05
        assert float(found.squares) < 0.02 * float(base.squares)


def test_a_small_line_once_a_turn_tells_the_teeth_apart_beside_a_great_mean_that_leaks_into_it(mill):
    teeth, orders, rate_hz = 4, 16, 2000.0
    with jax.enable_x64(True):
        dataset = mill()
        cut = dataset.trials[0]
        line = np.zeros((orders + 1, 3), complex)
        line[0], line[1], line[teeth] = (0.0, 800.0, -500.0), (0.5j, 0.5, 0.0), (40.0, 30j, 5.0)
        trials, truth = [], np.random.default_rng(2).uniform(0.0, 2.0 * np.pi, 24)
        for index, phase in enumerate(truth):
            # few turns, and no whole number of them
            time = np.arange(1537) / rate_hz
            angle = 2.0 * np.pi * cut.spindle_speed_rev_s * time + phase
            turned = np.exp(1j * np.arange(orders + 1) * angle[:, None]) * np.r_[1.0, np.full(orders, 2.0)]
            trials.append(
                dataclasses.replace(cut, file=f"{index}.csv", time_s=time, force_n=np.real(turned @ line))
            )
        sensor = dataclasses.replace(dataset.sensor, sample_rate_hz=rate_hz, anti_alias=None)
        cuts = dataclasses.replace(dataset, trials=tuple(trials), sensor=sensor)
        speeds = np.full(len(trials), cut.spindle_speed_rev_s)
        lines = compress(cuts, (0.0, 700.0), speeds)
        model = np.zeros((lines.orders + 1, 3), complex)
        model[: orders + 1] = line
        model[0] *= 0.99
        left = residual_of_lines(pose(cuts, lines), np.tile(model, (len(trials), 1, 1)))
    apart = np.asarray(left.phase_rad) - truth
    np.testing.assert_allclose(np.exp(1j * apart), 1.0, atol=0.02)


def test_orders_heard_in_no_trial_take_no_room(mill):
    with jax.enable_x64(True):
        dataset = mill()
        lines = compress(dataset, (500.0, 1000.0))
        problem = pose(dataset, lines)
        heard = np.flatnonzero(lines.present[:, 1::2].any(axis=0)) + 1
        kept = np.asarray(problem.heard)
        assert set(heard) <= set(kept) and len(kept) < lines.orders and len(kept) - len(heard) < 8
        np.testing.assert_array_equal(problem.order, np.concatenate([[0], np.repeat(kept, 2)]))
        # nothing that was measured is lost
        np.testing.assert_allclose(
            np.sum(np.asarray(problem.whitened) ** 2), np.sum(lines.whitened**2), rtol=1e-12
        )
        gram = np.asarray(problem.factor) @ np.swapaxes(np.asarray(problem.factor), 1, 2)
        whole = lines.factor @ np.swapaxes(lines.factor, 1, 2)
        columns = np.concatenate([[0], np.stack([2 * kept - 1, 2 * kept], axis=1).ravel()])
        np.testing.assert_allclose(gram, whole[:, columns[:, None], columns], rtol=1e-9, atol=1e-9)
