"""Sums over many shapes, the fast way and sample by sample."""

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing.along.layers import together
from mjx_cutting.tracing.along.periodic import PERIODIC
from mjx_cutting.tracing.along.shapes import Sums, solve, sums
from mjx_cutting.tracing.along.slow_kinds import KINDS, of_each_direction
from mjx_cutting.tracing.records.course import Course

SUMMED_FASTER = [kind for kind in (*KINDS, *of_each_direction(KINDS)) if kind.sums is not None]
STACKED = [kind for kind in SUMMED_FASTER if kind.stack is not None]


def course(samples: int, feed_m_s: float, apart: bool = False) -> Course:
    """A saw's trial at 500 Hz, its force changing by 2 % every 5 mm, with noise."""
    rng = np.random.default_rng(samples)
    time = np.arange(samples) / 500.0
    tooth = 2.0 * np.pi * 80.0 * time[:, None] + np.arange(3)
    chip = 30.0 + 10.0 * np.cos(tooth) + 3.0 * np.sin(tooth / 4.0)
    wave = np.cos(2.0 * np.pi * feed_m_s * time / 0.005)[:, None]
    return Course(
        time_s=time,
        position_m=feed_m_s * time + 1e-6 * rng.normal(size=samples),
        feed_share=None,
        chip_n=chip,
        edge_n=5.0 + 4.0 * np.cos(2.0 * tooth),
        left_n=0.02 * chip * wave + rng.normal(size=(samples, 3)),
        rate_hz=500.0,
        band_hz=(0.0, 200.0),
        apart=apart,
        by_direction=lambda: chip[..., None] * np.array([0.7, 0.2 * np.cos(tooth[0, 0]), 0.0]),
        border_power=(1.0, 2.0, 1.0),
    )


@pytest.mark.parametrize("apart", [False, True])
@pytest.mark.parametrize("kind", SUMMED_FASTER, ids=lambda kind: kind.name)
def test_fast_sums_are_those_of_the_samples(kind, apart):
    trials = [course(3000, 0.002, apart), course(3000, 0.004, apart)]
    grid = kind.grid(trials)
    few = grid[:: max(1, len(grid) // 40)]
    exact, fast = sums(kind.columns, trials, few), kind.sums_of(trials, few)
    for left, right in ((exact.square, fast.square), (exact.product, fast.product)):
        np.testing.assert_allclose(right, left, atol=1e-5 * np.abs(left).max())


@pytest.mark.parametrize("apart", [False, True])
@pytest.mark.parametrize("layers", STACKED, ids=["alike", "by direction"])
def test_sums_of_a_stack_are_those_of_the_samples(layers, apart):
    """Of records as short as the blocks are, exactly; however much longer one is than another."""
    trials = [course(1500, 0.002, apart), course(2000, 0.004, apart)]
    shapes = np.array([[0.001, 0.001, 1e-4], [0.0015, 0.002, 3e-4], [0.004, 0.002, 1e-4]])
    exact, fast = together(layers, trials, shapes), layers.stack(trials)(shapes)
    for left, right in ((exact.square, fast.square), (exact.product, fast.product)):
        np.testing.assert_allclose(right, left, atol=1e-9 * np.abs(left).max())


def test_a_layer_that_one_trial_alone_reaches_hides_none_that_several_show():
    """It explains more, but nothing that could be held out."""
    layers = next(each for each in KINDS if each.name == "layered_material")
    assert layers.shared
    trials = []
    for samples, feed in ((3000, 0.002), (3000, 0.0022), (3000, 0.0024), (6000, 0.003)):
        one = course(samples, feed)
        place = one.position_m
        share = 0.06 * ((place > 0.004) & (place < 0.008)) + 0.3 * ((place > 0.015) & (place < 0.017))
        noise = np.random.default_rng(samples).normal(size=(samples, 3))
        trials.append(replace(one, left_n=share[:, None] * one.force(1.0) + noise))
    shapes = np.array([[0.004, 0.004, 2e-5], [0.015, 0.002, 2e-5]])
    found, use, weight = layers.sums_of(trials, shapes), np.ones(4), np.ones(3)
    most, _, fall = solve(found, use, weight)
    best, c, _ = solve(found, use, weight, shared=True)
    assert most == 1 and fall[1] > 1.5 * fall[0]
    assert best == 0 and abs(c[0] - 0.06) < 0.02


def test_shapes_of_either_edge_share_keep_their_order():
    kind = next(each for each in KINDS if each.name == "material_periodicity")
    shapes = np.array([[0.02, 1.0, 0.0], [0.005, 0.0, 0.0], [0.01, 1.0, 0.0], [0.004, 0.0, 0.0]])
    exact, fast = (way([course(3000, 0.003)], shapes) for way in (_sample_by_sample(kind), kind.sums_of))
    np.testing.assert_allclose(fast.square, exact.square, rtol=1e-4, atol=1e-5 * exact.square.max())


def _at_teeth(trial: Course) -> Course:
    """The trial with a tooth in the cut from 2 to 12 mm ahead of the tool's centre."""
    ahead = 0.005 * np.sin(2.0 * np.pi * 80.0 * trial.time_s)

    def turned(waves):
        turn = np.exp(1j * np.multiply.outer(waves, ahead))[:, None, :, None]
        return turn * np.stack([trial.chip_n, trial.edge_n])

    return replace(trial, ahead_m=(0.002, 0.012), at_teeth=turned)


def test_a_pattern_met_by_teeth_is_summed_as_its_samples_are():
    """Shapes near one another share one carrier: off by a fifth of a radian at most at first, by nothing
    where they have been refined."""
    kind = next(each for each in KINDS if each.name == "material_periodicity")
    trials = [_at_teeth(course(3000, 0.003)), _at_teeth(course(3000, 0.005))]
    grid = kind.grid(trials)
    far = grid[grid[:, 2] == 1.0][::4]
    assert len(far) > 10 and far[:, 0].min() < 3e-3
    near = kind.refine(grid, np.array([0.0047, 0.0, 1.0]), 216.0)
    for shapes, within in ((far, 0.1), (near, 1e-3)):
        exact, fast = sums(kind.columns, trials, shapes), kind.sums_of(trials, shapes)
        for left, right in ((exact.square, fast.square), (exact.product, fast.product)):
            np.testing.assert_allclose(right, left, atol=within * np.abs(left).max())


def test_blocks_of_a_long_record_are_short_against_a_layer():
    kind = next(each for each in KINDS if each.name == "layered_material")
    trial = course(30_000, 0.002)
    shapes = np.array([[0.02, 0.01, 2e-5], [0.05, 0.03, 2e-5]])
    exact, fast = (way([trial], shapes) for way in (_sample_by_sample(kind), kind.sums_of))
    np.testing.assert_allclose(fast.square, exact.square, rtol=2e-3)


def _sample_by_sample(kind):
    return lambda trials, shapes: sums(kind.columns, trials, shapes)


def test_where_a_place_ends_may_show_in_one_trial_alone_but_not_that_it_is_there():
    """What three trials [R] explain of shapes [P], in units in which the best coefficient is one."""
    explained = np.array([[1.0, 1.0, 5.0], [1.0, 1.0, 8.0], [0.0, 0.0, 20.0]]).T
    found = Sums(explained[:, :, None, None, None], explained[:, :, None, None])
    best, coefficients, _ = solve(found, np.ones(3), np.ones(1), shared=True)
    assert best == 1 and coefficients == pytest.approx([1.0])
    assert solve(found, np.ones(3), np.ones(1))[0] == 2


@pytest.mark.parametrize(("path_m", "longest_m"), [(0.015, 0.0075), (0.025, 0.01), (0.09, 0.03)])
def test_a_wave_longer_than_usual_must_come_three_times_in_the_path(path_m, longest_m):
    time = np.arange(4000) / 1000.0
    force = np.ones((4000, 3))
    courses = [
        Course(time, share * path_m * time / time[-1], None, force, force, force, 1000.0, (0.0, 400.0))
        for share in (0.5, 1.0)
    ]
    wavelengths = PERIODIC.grid(courses)[:, 0]
    assert wavelengths.max() == pytest.approx(longest_m, rel=0.1)
    assert wavelengths.max() <= longest_m
