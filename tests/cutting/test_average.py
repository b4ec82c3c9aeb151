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


@pytest.mark.parametrize(("kind", "teeth"), [("drill", 2), ("turning", 1)])
def test_mean_load_of_other_tools(kind: str, teeth: int):
    model = ForceModel(Tool(kind, teeth, 0.01), MATERIAL)
    cut = Cut(0.7, 20.0, 0.004, 0.0, 0.002, 0.0, 0.0)
    load = mean_load(model, cut)
    np.testing.assert_allclose(load.force, model.process_force(cut), atol=1e-9)
    np.testing.assert_allclose(load.chip_torque + load.edge_torque, model.torque_z(cut), rtol=1e-12)
