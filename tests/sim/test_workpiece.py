"""The height field: conservation, arcs, cutting over a cut, entry, exit and cutting through."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.sim import EnvConfig
from mjx_cutting.sim.workpiece import Workpiece

CONFIG = EnvConfig()
PIECE = Workpiece(CONFIG)
R = CONFIG.radius_m
THICK = jnp.float32(0.005)


@jax.jit
def pass_over(heights, along, height):
    """Heights after the saw has gone through poses [T], and the area removed."""

    def one(heights, pose):
        first = PIECE.window_at(pose[0])
        part, start = PIECE.take(heights, first)
        engagement = PIECE.meet(part, start, pose[0], pose[1], THICK)
        part, removed = PIECE.remove(part, start, pose[0], pose[1], THICK)
        return PIECE.put(heights, part, first), (removed, engagement)

    return jax.lax.scan(one, heights, jnp.stack([along, height], axis=1))


def straight(depth, count=4000, start=0.0, end=0.25):
    return jnp.linspace(start, end, count), jnp.full(count, -depth)


@pytest.mark.parametrize("depth", [0.0002, 0.001, 0.003, 0.008])
def test_removed_volume_is_the_change_of_the_surface(depth):
    fresh = PIECE.fresh(THICK)
    after, (removed, _) = pass_over(fresh, *straight(depth))
    change = float(jnp.sum(fresh - after)) * CONFIG.cell_m
    assert float(jnp.sum(removed)) == pytest.approx(change, rel=1e-4)
    assert float(after.min()) >= -float(THICK) - 1e-9
    assert np.all(np.asarray(after) <= np.asarray(fresh))


def test_a_whole_pass_removes_depth_times_length():
    after, (removed, _) = pass_over(PIECE.fresh(THICK), *straight(0.001))
    # the circle leaves an uncut wedge of a third of the chord at the far end of the path
    wedge = 0.001 * np.sqrt(2 * R * 0.001) / 3
    assert float(jnp.sum(removed)) == pytest.approx(0.001 * CONFIG.cut_m + wedge, rel=0.03)
    middle = np.asarray(after)[150:200]
    np.testing.assert_allclose(middle, -0.001, atol=2e-6)


def test_cutting_over_a_finished_cut_meets_nothing():
    after, _ = pass_over(PIECE.fresh(THICK), *straight(0.001))
    again, (removed, engagement) = pass_over(after, *straight(0.0009, start=0.05, end=0.2))
    assert float(jnp.sum(removed)) == 0.0
    assert float(jnp.max(engagement.contact)) == 0.0
    np.testing.assert_array_equal(np.asarray(after), np.asarray(again))


def test_a_deeper_second_pass_meets_the_difference():
    after, _ = pass_over(PIECE.fresh(THICK), *straight(0.001))
    _, (_, engagement) = pass_over(after, *straight(0.0015, start=0.0, end=0.2))
    np.testing.assert_allclose(np.asarray(engagement.depth_m)[-500:], 0.0005, rtol=0.02)


def test_the_steady_arc_is_that_of_conventional_milling():
    _, (_, engagement) = pass_over(PIECE.fresh(THICK), *straight(0.001))
    steady = slice(2000, 3000)
    np.testing.assert_allclose(np.asarray(engagement.exit_rad)[steady], np.arccos(1 - 0.001 / R), rtol=1e-4)
    np.testing.assert_allclose(np.asarray(engagement.entry_rad)[steady], 0.0, atol=1e-7)
    np.testing.assert_allclose(np.asarray(engagement.depth_m)[steady], 0.001, rtol=1e-4)


def test_approach_entry_and_exit():
    along, height = straight(0.001)
    _, (_, engagement) = pass_over(PIECE.fresh(THICK), along, height)
    chord = np.sqrt(2 * R * 0.001 - 0.001**2)
    contact = np.asarray(engagement.contact) > 0
    first = float(along[np.argmax(contact)])
    assert first == pytest.approx(CONFIG.approach_m - chord, abs=2e-4)
    # while entering, only the far part of the arc is in the sheet
    entering = np.argmax(contact) + 50
    assert float(engagement.entry_rad[entering]) > 0.5 * float(engagement.exit_rad[entering])
    # at the end of the sheet the arc closes
    assert float(engagement.exit_rad[-1]) < 0.01
    assert not contact[0]


def test_cutting_through_leaves_the_lower_part_of_the_arc_free():
    _, (_, engagement) = pass_over(PIECE.fresh(THICK), *straight(0.006))
    assert float(engagement.entry_rad[2500]) == pytest.approx(np.arccos(1 - 0.001 / R), rel=1e-3)
    assert float(engagement.exit_rad[2500]) == pytest.approx(np.arccos(1 - 0.006 / R), rel=1e-3)


def test_a_saw_above_the_sheet_touches_nothing():
    _, (removed, engagement) = pass_over(PIECE.fresh(THICK), *straight(-0.0001))
    assert float(jnp.sum(removed)) == 0.0 and float(jnp.max(engagement.contact)) == 0.0


def test_plunging_in_place_removes_a_circular_segment():
    depth = jnp.linspace(0.0, 0.001, 500)
    after, (removed, _) = pass_over(PIECE.fresh(THICK), jnp.full(500, 0.1), -depth)
    half = np.arccos(1 - 0.001 / R)
    segment = R**2 * (half - np.sin(half) * np.cos(half))
    assert float(jnp.sum(removed)) == pytest.approx(segment, rel=0.01)
    assert float(after[PIECE.material].min()) == pytest.approx(-0.001, abs=1e-5)
