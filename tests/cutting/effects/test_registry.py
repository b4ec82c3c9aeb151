"""Effects by name: registering one of your own, and what a faulty one is told."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting import (
    AbstractEffect,
    Cut,
    ForceModel,
    Material,
    Parameter,
    Tool,
    effect_class,
    effect_names,
    register,
)
from mjx_cutting.cutting.effects import registry


@pytest.fixture(autouse=True)
def clean_registry() -> Iterator[None]:
    before = dict(registry._EFFECTS)
    yield
    registry._EFFECTS.clear()
    registry._EFFECTS.update(before)


def wobble() -> type[AbstractEffect]:
    class Wobble(AbstractEffect):
        name = "wobble"
        stage = "tool"
        strength = "force_n"
        parameters: ClassVar[dict[str, Parameter]] = {
            "force_n": Parameter("N", 0.0, 50.0, identity=0.0, typical=2.0)
        }
        force_n: ArrayLike

        def body(self, force: Array, cut: Cut, model: ForceModel) -> Array:
            return force.at[..., 0].add(self.force_n * jnp.sin(jnp.asarray(cut.angle_rad)))

    return Wobble


def model(*effects: AbstractEffect) -> ForceModel:
    return ForceModel(Tool("end_mill", 2, 0.01), Material.from_n_mm(900, 25, 300, 18), effects)


def cut(angle: ArrayLike = 0.7) -> Cut:
    return Cut.milling(
        "slot",
        0.01,
        angle_rad=angle,
        spindle_speed_rev_s=50.0,
        feed_speed_m_s=0.01,
        radial_depth_m=0.01,
        axial_width_m=0.001,
    )


def test_one_class_and_one_decorator_reach_every_caller():
    kind = register(wobble())
    assert "wobble" in effect_names()
    assert effect_class("wobble") is kind
    more = model(kind(3.0))
    np.testing.assert_allclose(
        more.process_force(cut()) - model().process_force(cut()), [3.0 * np.sin(0.7), 0.0, 0.0], atol=1e-4
    )
    _, process, sensed = jax.jit(ForceModel.step)(more, more.init(), cut(), 1e-6)
    np.testing.assert_allclose(process, more.process_force(cut()), rtol=1e-3)
    np.testing.assert_allclose(sensed, process)
    again = ForceModel.from_dict(more.to_dict())
    np.testing.assert_allclose(again.process_force(cut()), more.process_force(cut()), rtol=1e-6)
    assert kind.size(more.tool) == 1
    assert float(kind.build(jnp.array([0.5]), more.tool).force_n) == 1.0
    assert float(kind.identity(more.tool).force_n) == 0.0


def test_registering_twice_is_harmless_but_a_name_belongs_to_one_class():
    kind = register(wobble())
    assert register(kind) is kind

    class Other(kind):  # type: ignore[valid-type, misc]
        pass

    with pytest.raises(ValueError, match="'wobble' is registered already; choose another name"):
        register(Other)


@pytest.mark.parametrize(
    ("attribute", "value", "message"),
    [
        ("name", "", "Wobble has no name"),
        ("stage", "gearbox", r"wobble: stage is 'gearbox'; expected one of spindle, chip, edge"),
        ("strength", "size", r"wobble: strength is 'size'; expected one of its parameters \(force_n\)"),
        ("parameters", {}, r"expected one of its parameters \(it declares none\)"),
    ],
)
def test_faulty_classes(attribute: str, value: object, message: str):
    kind = wobble()
    setattr(kind, attribute, value)
    with pytest.raises(ValueError, match=message):
        register(kind)


def test_an_unknown_name_offers_the_nearest():
    with pytest.raises(ValueError, match=r"unknown effect 'size_efect'; did you mean size_effect"):
        effect_class("size_efect")
