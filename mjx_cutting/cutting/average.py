"""The load averaged over a revolution, by quadrature over the arc of one tooth that stands for all.

    mean = N / (2 pi) x integral over the arc of f(theta) d theta

with f the local law, effects at the edge included. Differences between teeth average out and are left aside.
Effects of structure and spindle that answer to the mean load, not to single teeth, read it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from mjx_cutting.cutting.chip import Chip
from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.drilling import lever_m, to_process

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

_NODE, _WEIGHT = np.polynomial.legendre.leggauss(10)


class MeanLoad(NamedTuple):
    """Mean over a revolution: `force` [..., 3] on the tool, N; torques [...] of its parts, N m."""

    force: Array
    chip_torque: Array
    edge_torque: Array


def mean_load(model: ForceModel, cut: Cut) -> MeanLoad:
    """Mean force and torque under these conditions; `cut.angle_rad` does not matter."""
    chip = _sample(model, cut)
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
    swept = jnp.asarray(cut.exit_rad)[..., None, None] - entry
    if tool.kind == "drill":
        angle = 2.0 * jnp.pi * jnp.arange(tool.teeth) / tool.teeth + jnp.zeros_like(feed_m)
        width = 0.5 * jnp.asarray(tool.diameter_m) + jnp.zeros_like(feed_m)
        return Chip(angle, feed_m + jnp.zeros_like(angle), jnp.ones_like(angle), width)
    if tool.kind == "turning":
        angle = jnp.full_like(feed_m, 0.5 * jnp.pi)
        return Chip(angle, feed_m, jnp.full_like(feed_m, tool.teeth), width)
    angle = entry + swept * node
    share = tool.teeth * swept / (2.0 * jnp.pi) * weight + jnp.zeros_like(angle)
    return Chip(angle, feed_m * jnp.maximum(jnp.sin(angle), 0.0), share, width)
