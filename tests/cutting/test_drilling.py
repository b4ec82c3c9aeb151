"""Drills and turning tools on the same path."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, effect_class

pytestmark = pytest.mark.usefixtures("float64")

K_TC, K_TE, K_RC, K_RE, K_AC, K_AE = 1500e6, 30e3, 200e6, 10e3, 700e6, 40e3
MATERIAL = Material(K_TC, K_TE, K_RC, K_RE, K_AC, K_AE)
DIAMETER, SPEED, FEED_REV = 0.008, 25.0, 2e-4


def drill(*effects: Any, teeth: int = 2) -> ForceModel:
    return ForceModel(Tool("drill", teeth, DIAMETER), MATERIAL, effects)


def hole(angle: Any = 0.4, **change: Any) -> Cut:
    return Cut(angle, SPEED, FEED_REV * SPEED, 0.0, 0.0, 0.0, 0.0).replace(**change)


@pytest.mark.parametrize("teeth", [2, 3])
def test_thrust_and_torque_in_closed_form(teeth: int):
    chip, lip = FEED_REV / teeth, DIAMETER / 2
    force = drill(teeth=teeth).process_force(hole(jnp.linspace(0.0, 6.0, 7)))
    np.testing.assert_allclose(force[:, 2], teeth * lip * (K_AC * chip + K_AE), rtol=1e-12)
    np.testing.assert_allclose(force[:, :2], 0.0, atol=1e-9)
    torque = drill(teeth=teeth).torque_z(hole(jnp.linspace(0.0, 6.0, 7)))
    np.testing.assert_allclose(torque, teeth * lip * (K_TC * chip + K_TE) * DIAMETER / 4, rtol=1e-12)


def test_thrust_and_torque_are_linear_in_feed():
    feeds = np.array([1e-4, 2e-4, 4e-4])
    cuts = hole(np.zeros(3), feed_speed_m_s=feeds * SPEED)
    for values in (drill().process_force(cuts)[:, 2], drill().torque_z(cuts)):
        slope = np.diff(np.asarray(values)) / np.diff(feeds)
        np.testing.assert_allclose(slope[1], slope[0], rtol=1e-9)
        assert float(values[0] - slope[0] * feeds[0]) > 0.0


def test_wear_raises_thrust_and_torque_with_the_length_drilled():
    wear = effect_class("flank_wear")(np.array([1e9, 2e9, 3e9]), 1e-6)
    length = np.array([0.0, 1.0, 2.0])
    cuts = hole(np.zeros(3), cut_length_m=length)
    thrust = drill(wear).process_force(cuts)[:, 2] - drill().process_force(cuts)[:, 2]
    torque = drill(wear).torque_z(cuts) - drill().torque_z(cuts)
    np.testing.assert_allclose(thrust, 2 * DIAMETER / 2 * 3e9 * 1e-6 * length, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(
        torque, 2 * DIAMETER / 2 * 1e9 * 1e-6 * length * DIAMETER / 4, rtol=1e-9, atol=1e-12
    )


def test_a_longer_lip_takes_more_and_the_side_force_turns():
    """The lip that is 10 um longer cuts 20 um more than the other; the sum of chips stays the feed."""
    runout = effect_class("radial_runout")(5e-6, 0.0)
    angles = jnp.linspace(0.0, 2 * np.pi, 9)[:-1]
    chip = drill(runout).chip(hole(angles))
    np.testing.assert_allclose(chip.thickness_m[0, 0], [FEED_REV / 2 + 1e-5, FEED_REV / 2 - 1e-5], rtol=1e-9)
    force = drill(runout).process_force(hole(angles))
    np.testing.assert_allclose(force[:, 2], drill().process_force(hole())[2], rtol=1e-9)
    side = np.hypot(force[:, 0], force[:, 1])
    np.testing.assert_allclose(side, side[0], rtol=1e-9)
    assert side[0] > 1.0


def test_turning_is_constant_and_in_closed_form():
    lathe = ForceModel(Tool("turning", 1, 0.04), MATERIAL)
    width = 0.002
    cuts = Cut(jnp.linspace(0.0, 9.0, 5), SPEED, FEED_REV * SPEED, 0.0, width, 0.0, 0.0)
    expected = [
        -width * (K_RC * FEED_REV + K_RE),
        width * (K_TC * FEED_REV + K_TE),
        -width * (K_AC * FEED_REV + K_AE),
    ]
    np.testing.assert_allclose(lathe.process_force(cuts), [expected] * 5, rtol=1e-12)
    np.testing.assert_allclose(lathe.torque_z(cuts), expected[1] * 0.02, rtol=1e-12)


@pytest.mark.parametrize("kind", ["drill", "turning"])
def test_no_feed_leaves_the_edge_force_and_gradients_are_finite(kind: str):
    model = ForceModel(Tool(kind, 2 if kind == "drill" else 1, 0.01), MATERIAL)
    cut = Cut(0.2, SPEED, 0.0, 0.0, 0.002, 0.0, 0.0)
    width = 0.01 if kind == "drill" else 0.002
    assert abs(float(model.process_force(cut)[2])) == pytest.approx(width * K_AE)
    slope = jax.grad(lambda m: m.process_force(cut)[2] + m.torque_z(cut))(model)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(slope))


def test_a_step_of_the_simulation():
    state, process, sensed = jax.jit(ForceModel.step)(drill(), (), hole(), 0.002)
    assert state == ()
    np.testing.assert_allclose(process, drill().process_force(hole()), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(sensed, process)
