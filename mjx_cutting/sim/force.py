"""The cutting force over one physics step.

With effects, `ForceModel.step` samples tool angles inside the step. Without, the base model is integrated in
closed form over the angles that the engaged teeth sweep, which is what those samples converge to and needs
only the few teeth that can be in the arc:

    integral of (-Ft cos - Fr sin) etc. with Ft = b (K_te + K_tc c sin th), Fr = b (K_re + K_rc c sin th)

so only sin and cos at both ends of each tooth's stretch inside the arc are wanted. Valid for straight teeth
and arcs up to `MAX_DEPTH_M` deep; a saw that is drawn in deeper ends the episode (`EnvConfig.max_depth_m`).
"""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool
from mjx_cutting.sim.config import MAX_DEPTH_M, EnvConfig
from mjx_cutting.sim.vectors import Scalar, Vector


def is_plain(model: ForceModel) -> bool:
    """Whether the base model's closed form serves: no effects, straight teeth."""
    return not model.effects and model.tool.slices == 1


def modelled_force(
    model: ForceModel, memory: Any, cut: Cut, dt_s: float, samples: int
) -> tuple[Any, Vector, Vector]:
    """Memory of the model, force on the tool and force sensed (process axes, N), means over the step."""
    memory, process, sensed = model.step(memory, cut, dt_s, samples)
    return memory, _split(process), _split(sensed)


def from_process(force: Vector) -> Vector:
    """Process axes (feed, into the sheet, tool axis) to base axes: x_p = -y_b, y_p = -z_b, z_p = x_b."""
    return (force[2], -force[0], -force[1])


def base_force(tool: Tool, material: Material, cut: Cut, dt_s: float, speed_rev_s: float) -> Vector:
    """Mean force of the base model over a step of `dt_s` at constant spindle speed, process axes, N."""
    teeth, turn = tool.teeth, 2.0 * math.pi * speed_rev_s * dt_s
    pitch = 2.0 * math.pi / teeth
    widest = math.acos(1.0 - min(MAX_DEPTH_M / (0.5 * float(np.asarray(tool.diameter_m))), 1.0))
    first = -math.ceil(turn / pitch)
    last = min(math.ceil(widest / pitch), teeth + first)
    angle = jnp.asarray(cut.angle_rad)
    lead = angle - pitch * jnp.floor(angle / pitch)
    leave = jnp.minimum(jnp.asarray(cut.exit_rad), widest)
    cosines: Scalar = 0.0
    sines: Scalar = 0.0
    mixed: Scalar = 0.0
    squares: Scalar = 0.0
    spans: Scalar = 0.0
    for k in range(first, last + 1):
        low = jnp.clip(lead + k * pitch, cut.entry_rad, leave)
        high = jnp.clip(lead + (k * pitch + turn), cut.entry_rad, leave)
        sin_low, cos_low, sin_high, cos_high = jnp.sin(low), jnp.cos(low), jnp.sin(high), jnp.cos(high)
        cosines += sin_high - sin_low
        sines += cos_low - cos_high
        mixed += 0.5 * (sin_high * sin_high - sin_low * sin_low)
        squares += 0.5 * ((high - low) - (sin_high * cos_high - sin_low * cos_low))
        spans += high - low
    chip = jnp.maximum(jnp.asarray(cut.feed_speed_m_s), 0.0) / (teeth * jnp.asarray(cut.spindle_speed_rev_s))
    share = jnp.asarray(cut.axial_width_m) / turn
    tangential, radial, axial = (
        material.K_tc_n_m2 * chip,
        material.K_rc_n_m2 * chip,
        material.K_ac_n_m2 * chip,
    )
    along = material.K_te_n_m * cosines + tangential * mixed + material.K_re_n_m * sines + radial * squares
    into = material.K_te_n_m * sines + tangential * squares - material.K_re_n_m * cosines - radial * mixed
    across = material.K_ae_n_m * spans + axial * sines
    return (-share * along, share * into, -share * across)


def memory(model: ForceModel) -> Any:
    """The model's memory at rest, as arrays of the default precision."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, float), model.init())


def _split(force: Array) -> Vector:
    return (force[..., 0], force[..., 1], force[..., 2])


def saw_model(config: EnvConfig, model: ForceModel | None) -> ForceModel:
    """The saw of the config (or of the model, where it is a saw) with the model's effects; tried once."""
    tool = Tool("slitting_saw", config.teeth, config.diameter_m)
    material = Material(0.0, 0.0, 0.0, 0.0)
    if model is None:
        return ForceModel(tool, material)
    own = model.tool if model.tool.kind == "slitting_saw" else tool
    saw = ForceModel(own, material, model.effects)
    try:
        jax.eval_shape(saw.init)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"the effects {[effect.name for effect in model.effects]} do not fit a saw with {own.teeth} "
            f"teeth ({error}); expected parameters for that many teeth"
        ) from error
    return saw
