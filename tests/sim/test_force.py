"""The closed form of the base force against the force model's own samples and published mean forces."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool
from mjx_cutting.sim.force import MAX_DEPTH_M, base_force, from_process

SAW = Tool("slitting_saw", 20, 0.05)
SHEET = Material.from_n_mm(K_tc=600.0, K_te=20.0, K_rc=150.0, K_re=6.0, K_ac=30.0, K_ae=2.0)
DT, SPEED = 0.002, 19.0


def cut(angle, depth=0.001, feed=0.0125, entry=0.0):
    return Cut(
        angle_rad=angle,
        spindle_speed_rev_s=jnp.float32(SPEED),
        feed_speed_m_s=feed,
        radial_depth_m=depth,
        axial_width_m=jnp.float32(0.0016),
        entry_rad=entry,
        exit_rad=jnp.arccos(1.0 - jnp.float32(depth) / 0.025),
    )


@pytest.mark.parametrize("depth", [0.0, 2e-5, 0.001, 0.002, 0.0055])
@pytest.mark.parametrize("entry", [0.0, 0.1])
def test_it_is_what_the_samples_of_the_force_model_converge_to(depth, entry):
    model = ForceModel(SAW, SHEET)
    for angle in np.linspace(0.0, 6.2, 7):
        here = cut(jnp.float32(angle), depth, entry=min(entry, float(np.arccos(1 - depth / 0.025))))
        ours = np.asarray(base_force(SAW, SHEET, here, DT, SPEED))
        _, sampled, _ = model.step(model.init(), here, DT, samples=2000)
        scale = 0.002 * (1.0 + np.abs(np.asarray(sampled)).max())
        np.testing.assert_allclose(ours, np.asarray(sampled), atol=scale)


def test_eight_samples_agree_in_the_mean_over_a_turn():
    model = ForceModel(SAW, SHEET)
    angles = jnp.linspace(0.0, 2.0 * jnp.pi, 200, endpoint=False)
    ours = jax.vmap(lambda a: jnp.stack(base_force(SAW, SHEET, cut(a), DT, SPEED)))(angles)
    theirs = jax.vmap(lambda a: model.step((), cut(a), DT, samples=8)[1])(angles)
    np.testing.assert_allclose(ours.mean(axis=0), theirs.mean(axis=0), rtol=0.005)


def test_the_published_mean_force_of_a_quarter_arc():
    # N = 4, width 2 mm, .05 mm a tooth, K = (796, 168.8) N/mm^2, K_e = (27.7, 30.8) N/mm, arc 0 to pi/2
    mill = Tool("end_mill", 4, 0.01)
    material = Material.from_n_mm(K_tc=796.0, K_te=27.7, K_rc=168.8, K_re=30.8)
    turn = 2.0 * np.pi * SPEED * DT

    def mean(angle):
        here = Cut(angle, jnp.float32(SPEED), jnp.float32(0.05e-3 * 4 * SPEED), 0.005, 0.002, 0.0, jnp.pi / 2)
        return jnp.stack(base_force(mill, material, here, DT, SPEED))

    angles = jnp.linspace(0.0, 2.0 * jnp.pi, 4000, endpoint=False) - turn
    force = jax.vmap(mean)(angles).mean(axis=0)
    np.testing.assert_allclose(np.asarray(force), [-108.2620, 30.4799, 0.0], rtol=2e-4, atol=1e-3)


def test_backing_away_cuts_no_chip():
    away = base_force(SAW, SHEET, cut(jnp.float32(0.1), feed=-0.01), DT, SPEED)
    still = base_force(SAW, SHEET, cut(jnp.float32(0.1), feed=0.0), DT, SPEED)
    np.testing.assert_allclose(np.asarray(away), np.asarray(still), rtol=1e-6)


def test_frames():
    # x_p = -y_b, y_p = -z_b, z_p = x_b
    np.testing.assert_array_equal(np.asarray(from_process((1.0, 0.0, 0.0))), [0.0, -1.0, 0.0])
    np.testing.assert_array_equal(np.asarray(from_process((0.0, 1.0, 0.0))), [0.0, 0.0, -1.0])
    np.testing.assert_array_equal(np.asarray(from_process((0.0, 0.0, 1.0))), [1.0, 0.0, 0.0])


def test_the_arc_it_covers_is_stated():
    deep = base_force(SAW, SHEET, cut(jnp.float32(0.0), MAX_DEPTH_M), DT, SPEED)
    deeper = base_force(SAW, SHEET, cut(jnp.float32(0.0), 2.0 * MAX_DEPTH_M), DT, SPEED)
    np.testing.assert_allclose(np.asarray(deep), np.asarray(deeper), rtol=1e-4)
