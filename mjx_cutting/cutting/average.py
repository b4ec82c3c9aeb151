"""The load averaged over a revolution, by quadrature over the arc.

    mean = 1 / (2 pi) x sum over the teeth of the integral over the arc of f(theta) d theta

with f the local law, effects at the edge included. Of teeth that are alike one stands for all. Of others the
chips average out, but a tooth that does not reach the sheet does not rub either: each is looked at by itself.
Effects of structure and spindle that answer to the mean load, not to single teeth, read it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mjx_cutting.cutting.chip import Chip, chip_in_arc, swept
from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.drilling import lever_m, to_process

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

_NODE, _WEIGHT = np.polynomial.legendre.leggauss(10)
_BORDERS = np.concatenate([[-1.0], -1.0 + np.cumsum(_WEIGHT)])
_CELLS = 0.5 * np.stack([_NODE - _BORDERS[:-1], _BORDERS[1:] - _NODE], axis=-1)


class MeanLoad(NamedTuple):
    """Mean over a revolution: `force` [..., 3] on the tool, N; torques [...] of its parts, N m."""

    force: Array
    chip_torque: Array
    edge_torque: Array


def mean_load(model: ForceModel, cut: Cut, as_alike: bool = False) -> MeanLoad:
    """Mean force and torque under these conditions; `cut.angle_rad` does not matter. `as_alike`: as if every
    tooth did what the others do, which costs little."""
    model = replace(model, effects=tuple(each for each in model.effects if not each.evens_out))
    if as_alike or teeth_alike(model):
        return _of_chip(model, cut, _sample(model, cut))
    batch = jnp.broadcast_shapes(*(jnp.shape(leaf) for leaf in jax.tree.leaves(cut)))
    if not batch:
        return _of_teeth(model, cut)
    flat = jax.tree.map(lambda leaf: jnp.broadcast_to(jnp.asarray(leaf), batch).reshape(-1), cut)
    each = jax.vmap(lambda one: _of_teeth(model, one))(flat)
    return jax.tree.map(lambda leaf: leaf.reshape(*batch, *leaf.shape[1:]), each)


def teeth_alike(model: ForceModel) -> bool:
    """Whether one tooth stands for all in the mean."""
    if model.tool.kind in ("drill", "turning"):
        return True
    return model.cutter().even and not any(effect.idle_teeth for effect in model.effects)


def _of_teeth(model: ForceModel, cut: Cut) -> MeanLoad:
    """The mean of teeth that are not alike, under scalar conditions."""
    cutter = model.cutter()._replace(slices=1, helix_rad=jnp.zeros(()))
    entry, leave = swept(cutter, cut, model.tool)
    arc = leave - entry
    chip = chip_in_arc(cutter, cut, model.tool, entry + arc * (0.5 + 0.5 * _NODE), arc * _CELLS)
    for effect in model.effects:
        chip = effect.chip(chip, cut, model) if effect.idle_teeth else chip
    share = (arc / (4.0 * jnp.pi) * _WEIGHT)[:, None, None]
    load = _of_chip(model, cut, chip._replace(contact=share * chip.contact))
    return jax.tree.map(lambda leaf: jnp.sum(leaf, axis=0), load)


def _of_chip(model: ForceModel, cut: Cut, chip: Chip) -> MeanLoad:
    """What edges carry whose contact holds the weight of each in the mean."""
    local = model.edge_force(chip, cut)
    share = chip.contact * lever_m(model.tool)
    return MeanLoad(
        to_process(local.chip + local.edge, chip, model.tool),
        jnp.sum(local.chip[..., 0] * share, axis=(-2, -1)),
        jnp.sum(local.edge[..., 0] * share, axis=(-2, -1)),
    )


def _sample(model: ForceModel, cut: Cut) -> Chip:
    """Chip at the quadrature nodes; `contact` carries their weights."""
    tool = model.tool
    feed_m = jnp.asarray(cut.feed_per_revolution_m())[..., None, None] / tool.teeth
    node, weight = jnp.asarray(0.5 + 0.5 * _NODE), jnp.asarray(0.5 * _WEIGHT)
    width = jnp.asarray(cut.axial_width_m)[..., None, None]
    entry = jnp.asarray(cut.entry_rad)[..., None, None]
    arc = jnp.asarray(cut.exit_rad)[..., None, None] - entry
    if tool.kind == "drill":
        angle = 2.0 * jnp.pi * jnp.arange(tool.teeth) / tool.teeth + jnp.zeros_like(feed_m)
        width = 0.5 * jnp.asarray(tool.diameter_m) + jnp.zeros_like(feed_m)
        return Chip(angle, feed_m + jnp.zeros_like(angle), jnp.ones_like(angle), width)
    if tool.kind == "turning":
        angle = jnp.full_like(feed_m, 0.5 * jnp.pi)
        return Chip(angle, feed_m, jnp.full_like(feed_m, tool.teeth), width)
    angle = entry + arc * node
    share = tool.teeth * arc / (2.0 * jnp.pi) * weight + jnp.zeros_like(angle)
    return Chip(angle, feed_m * jnp.maximum(jnp.sin(angle), 0.0), share, width)
