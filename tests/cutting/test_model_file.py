"""A model as a dictionary and back, and what a faulty one is told."""

from __future__ import annotations

import json
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, effect_class


def model() -> ForceModel:
    effects = (
        effect_class("radial_runout")(1.16e-5, 0.3),
        effect_class("unequal_pitch")(jnp.array([0.01, -0.01])),
        effect_class("size_effect")(0.2),
        effect_class("sensor_resonance")(420.0, 0.06),
    )
    return ForceModel(
        Tool("end_mill", 2, 0.025, 0.7), Material.from_n_mm(958.9, 15.76, 250.9, 19.43), effects
    )


def written() -> dict[str, Any]:
    return json.loads(json.dumps(model().to_dict()))


def test_round_trip_through_json():
    read = ForceModel.from_dict(written())
    assert read.tool.kind == "end_mill"
    assert (read.tool.teeth, read.tool.slices) == (2, model().tool.slices)
    assert [effect.name for effect in read.effects] == [effect.name for effect in model().effects]
    cut = Cut.milling(
        "slot",
        0.025,
        angle_rad=jnp.linspace(0.0, 6.0, 9),
        spindle_speed_rev_s=50.0,
        feed_speed_m_s=0.01,
        radial_depth_m=0.025,
        axial_width_m=0.0015,
    )
    np.testing.assert_allclose(read.process_force(cut), model().process_force(cut), rtol=1e-6)
    assert read.to_dict() == written()


def test_what_is_written():
    data = written()
    assert data["format"] == "mjx-cutting-model/1"
    assert data["tool"] == {"kind": "end_mill", "teeth": 2, "diameter_m": 0.025, "helix_rad": 0.7}
    assert data["effects"][0] == {
        "name": "radial_runout",
        "parameters": {"offset_m": pytest.approx(1.16e-5), "angle_rad": pytest.approx(0.3)},
    }
    assert data["material"]["K_tc_n_m2"] == pytest.approx(958.9e6)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda d: d.update(format="other/2"), r"'other/2'; expected 'mjx-cutting-model/1'"),
        (lambda d: d.pop("format"), r"expected 'mjx-cutting-model/1'"),
        (lambda d: d["tool"].pop("teeth"), r"tool or material is incomplete"),
        (lambda d: d["material"].update(K_xx=1.0), r"tool or material .* unknown keys"),
        (lambda d: d["effects"][0].update(name="radial_runot"), r"did you mean radial_runout"),
        (
            lambda d: d["effects"][0].update(name="gremlin"),
            r"unknown effect 'gremlin'.*Known effects: .*size_effect",
        ),
        (
            lambda d: d["effects"][0]["parameters"].pop("angle_rad"),
            r"parameters are \['offset_m'\]; expected",
        ),
        (lambda d: d["effects"][0]["parameters"].update(offset_mm=1), r"offset_mm.*expected .* in SI units"),
        (lambda d: d["tool"].update(kind="router"), r"'router'; expected one of"),
    ],
)
def test_faulty_models(damage: Any, message: str):
    data = written()
    damage(data)
    with pytest.raises(ValueError, match=message):
        ForceModel.from_dict(data)


def test_more_effects_keep_the_old_ones():
    more = ForceModel(Tool("end_mill", 2, 0.01), Material.from_n_mm(900, 25, 300, 18)).with_effects(
        effect_class("size_effect")(0.1)
    )
    names = [effect.name for effect in more.with_effects(effect_class("radial_runout")(1e-6, 0.0)).effects]
    assert names == ["size_effect", "radial_runout"]
