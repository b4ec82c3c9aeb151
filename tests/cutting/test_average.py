"""The mean load by quadrature, against a revolution at many angles."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
import pytest

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, effect_class, revolution
from mjx_cutting.cutting.average import mean_load

pytestmark = pytest.mark.usefixtures("float64")

MATERIAL = Material.from_n_mm(900.0, 20.0, 300.0, 12.0, 60.0, 3.0)
wave_of = jax.jit(revolution, static_argnums=2)


@pytest.mark.parametrize("milling", ["slot", "conventional", "climb"])
@pytest.mark.parametrize("effects", [(), ("flank_wear", "ploughing")], ids=["base", "edge effects"])
def test_mean_load_is_the_mean_of_a_revolution(milling: str, effects: tuple[str, ...]):
    tool = Tool("end_mill", 4, 0.02)
    built: list[Any] = [effect_class(n).build(effect_class(n).starts(tool)[0], tool) for n in effects]
    model = ForceModel(tool, MATERIAL, tuple(built))
    cut = Cut.milling(
        milling,
        0.02,
        angle_rad=0.3,
        spindle_speed_rev_s=40.0,
        feed_speed_m_s=0.008,
        radial_depth_m=0.005,
        axial_width_m=0.002,
        cut_length_m=4.0,
    )
    load = mean_load(model, cut)
    np.testing.assert_allclose(load.force, wave_of(model, cut, 7200).mean(axis=0), rtol=2e-4, atol=2e-3)
    turning = cut.replace(angle_rad=2 * np.pi / 7200 * np.arange(7200), gate_rad=2 * np.pi / 7200)
    torque = jax.jit(ForceModel.torque_z)(model, turning).mean()
    np.testing.assert_allclose(load.chip_torque + load.edge_torque, torque, rtol=5e-4)


SAW = Tool("slitting_saw", 28, 0.063)
RUN_OUT = effect_class("radial_runout")(14e-6, 0.6)
BROKEN = effect_class("broken_tooth")(1.0, 5.0, 0.0)


def _sawing(milling: str, feed_speed_m_s: float) -> Cut:
    return Cut.milling(
        milling,
        0.063,
        angle_rad=0.0,
        spindle_speed_rev_s=6.0,
        feed_speed_m_s=feed_speed_m_s,
        radial_depth_m=0.0012,
        axial_width_m=0.0016,
    )


@pytest.mark.parametrize("milling", ["conventional", "climb"])
@pytest.mark.parametrize("feed_speed_m_s", [0.0013, 0.003, 0.01])
@pytest.mark.parametrize("effect", [RUN_OUT, BROKEN], ids=["runout", "broken tooth"])
def test_teeth_that_do_not_reach_the_sheet_are_no_part_of_the_load(milling, feed_speed_m_s, effect):
    """At the lowest feed runout keeps nearly half of the teeth idle, of which no edge rubs."""
    model, cut = ForceModel(SAW, MATERIAL, (effect,)), _sawing(milling, feed_speed_m_s)
    load, alike = (mean_load(each, cut) for each in (model, ForceModel(SAW, MATERIAL)))
    np.testing.assert_allclose(load.force, wave_of(model, cut, 7200).mean(axis=0), rtol=0.01, atol=0.02)
    assert load.edge_torque < 0.99 * alike.edge_torque
    np.testing.assert_allclose(load.chip_torque, alike.chip_torque, rtol=0.01)


def test_each_of_several_cuts_has_its_own_load():
    model = ForceModel(SAW, MATERIAL, (RUN_OUT,))
    feeds = (0.0013, 0.003, 0.01)
    several = _sawing("conventional", feeds[0]).replace(feed_speed_m_s=np.array(feeds))
    found = mean_load(model, several)
    for index, feed in enumerate(feeds):
        alone = mean_load(model, _sawing("conventional", feed))
        np.testing.assert_allclose(found.force[index], alone.force, rtol=1e-9)
        np.testing.assert_allclose(found.edge_torque[index], alone.edge_torque, rtol=1e-9)


@pytest.mark.parametrize(("kind", "teeth"), [("drill", 2), ("turning", 1)])
def test_mean_load_of_other_tools(kind: str, teeth: int):
    model = ForceModel(Tool(kind, teeth, 0.01), MATERIAL)
    cut = Cut(0.7, 20.0, 0.004, 0.0, 0.002, 0.0, 0.0)
    load = mean_load(model, cut)
    np.testing.assert_allclose(load.force, model.process_force(cut), atol=1e-9)
    np.testing.assert_allclose(load.chip_torque + load.edge_torque, model.torque_z(cut), rtol=1e-12)
