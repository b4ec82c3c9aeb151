"""The lines that a force model has under the conditions of a fitting problem."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting import AbstractEffect, Cut, ForceModel, Tool, order_lines
from mjx_cutting.cutting.centre_motion import CentreMotion, felt_on
from mjx_cutting.cutting.effects.helix_lag import HelixLag
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.records.line_gain import helix_gain, slice_gain

_PLACES = 6
_SLICES = 4


def model_lines(
    problem: Problem, model: ForceModel, at_one_place: bool = False, heard: bool = False
) -> Array:
    """[R, orders + 1, 3] complex lines of the sensed force of every trial, or only those `heard`, tooth 0 at
    angle zero, N: their mean over the path, or `at_one_place` those there.

    The teeth are straight ones, since a helix only delays slices of the edge, which in the order domain is
    the exact factor (1 - exp(-i n lag)) / (i n lag) in `response`, whatever corrects its angle.
    """
    straight = with_straight_teeth(problem, model)
    if problem.tool.kind == "drill":
        return jax.vmap(partial(_thrust_and_torque, straight))(problem.cut)[:, None] + 0j
    orders, arc_rad = problem.orders, problem.arc_rad
    only = jnp.append(problem.heard, 0) if heard else None

    def along(cut: Cut, path_m: Array, motion: Array | None) -> Array:
        moving = straight if motion is None else straight.with_effects(CentreMotion(motion))

        def at(place: ArrayLike, stretch: tuple[ArrayLike, ArrayLike] | None = None) -> Array:
            here = cut.replace(position_m=place)
            here = here if motion is None else felt_on(here, motion, problem.angles)
            return order_lines(moving, here, orders, problem.angles, arc_rad, stretch, only)

        if at_one_place or not by_position(model):
            return at(cut.position_m)
        node, weight = np.polynomial.legendre.leggauss(_PLACES)
        places, share = cut.position_m + 0.5 * path_m * node, 0.5 * weight
        if all(each.transfer is not AbstractEffect.transfer for each in _by_position(model)):
            return at(cut.position_m, (places, share))
        return jnp.tensordot(share, jax.vmap(at)(places), axes=1)

    lines = jax.vmap(along)(problem.cut, problem.path_m, problem.motion) * np.array(problem.alive)
    return lines * response(problem, model)[..., None]


def with_straight_teeth(problem: Problem, model: ForceModel) -> ForceModel:
    """The model without a helix, or in few slices of it where the tool does not turn evenly."""
    slices = _slices(problem, model)
    helix_rad = _helix_rad(problem, model) if slices > 1 else 0.0
    tool = Tool(problem.tool.kind, problem.tool.teeth, problem.tool.diameter_m, helix_rad, slices)
    rest = tuple(each for each in model.effects if not isinstance(each, HelixLag))
    return ForceModel(tool, model.material, rest)


def response(problem: Problem, model: ForceModel) -> Array:
    """[R, orders + 1] what the known filter and the helix, with what corrects it, make of the lines of
    straight teeth, or of slices that are straight."""
    slices = _slices(problem, model)
    width = jnp.asarray(problem.cut.axial_width_m) / slices
    of_helix = slice_gain if slices > 1 else helix_gain
    return problem.gain * of_helix(width, problem.tool.diameter_m, _helix_rad(problem, model), problem.orders)


def _slices(problem: Problem, model: ForceModel) -> int:
    swings = any(each.swings for each in model.effects)
    return _SLICES if swings and problem.tool.kind == "end_mill" else 1


def _helix_rad(problem: Problem, model: ForceModel) -> Array:
    corrections = (jnp.asarray(each.helix_rad) for each in model.effects if isinstance(each, HelixLag))
    return sum(corrections, start=jnp.asarray(problem.tool.helix_rad))


def by_position(model: ForceModel) -> bool:
    """Whether the response of an effect changes along the path."""
    return bool(_by_position(model))


def _by_position(model: ForceModel) -> list[type[AbstractEffect]]:
    return [type(effect) for effect in model.effects if effect.by_position]


def _thrust_and_torque(model: ForceModel, cut: Cut) -> Array:
    """[3] nothing, torque (N m) and thrust (N) of a drill as sensed, in the order of `levels`."""
    thrust = model.process_force(cut)[2]
    channels = jnp.stack([jnp.zeros_like(thrust), model.torque_z(cut), thrust])
    return model.sense(channels, cut).at[0].set(0.0)
