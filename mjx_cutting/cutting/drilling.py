"""Drills and turning tools: one edge always in the material, on the same path as a mill.

A drill has N lips of width D/2 that each take h = v / (N f):

    thrust = N (D/2) (K_ac h + K_ae),    torque = N (D/2) (K_tc h + K_te) D/4

so the torque per chip area is K_tc D / 4 a lip, the K_f h D / 2 of handbooks (Altintas, Manufacturing
Automation, 2nd ed. (2012), section 2.10). The thrust ON THE TOOL is counted positive along z, out of the
hole; in the cutting plane the lips hold each other in balance, and what a deviation from that leaves turns
with the drill. A lip that is longer than the others by r takes more chip, as a tooth of larger radius does.

A turning tool is one edge at the angle pi/2: x is the feed, y the cutting speed, h = v / f, width as given.

The law takes one set of constants over the whole lip, so the chisel edge is in the edge constants; it breaks
where the drill enters or leaves the sheet. All effects at the edge act here as on a mill: flank_wear adds to
the edge constants, thus to thrust and torque.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from mjx_cutting.cutting.chip import Chip, Cutter, carried_over, chip_under
from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.tool import Tool


def engaged_chip(cutter: Cutter, cut: Cut, tool: Tool) -> Chip:
    """Chip thickness and contact of every edge element, [..., S, N], for any kind of tool."""
    if tool.kind == "drill":
        return _drill_chip(cutter, cut, tool)
    if tool.kind == "turning":
        return _turning_chip(cutter, cut, tool)
    return chip_under(cutter, cut, tool)


def lever_m(tool: Tool) -> Array:
    """[] arm at which the tangential force turns against the spindle, m."""
    return jnp.asarray(tool.diameter_m) * (0.25 if tool.kind == "drill" else 0.5)


def to_process(local: Array, chip: Chip, tool: Tool) -> Array:
    """Sum of the local forces [..., S, N, 3] (tangential, radial, axial) in the process frame [..., 3], N."""
    return jnp.sum(elements_to_process(local, chip, tool), axis=(-3, -2))


def elements_to_process(local: Array, chip: Chip, tool: Tool) -> Array:
    """Force of each element in the process frame, [..., S, N, 3], N, its share of contact in it."""
    tangential, radial, axial = local[..., 0], local[..., 1], local[..., 2]
    sine, cosine = jnp.sin(chip.angle_rad), jnp.cos(chip.angle_rad)
    along = axial if tool.kind == "drill" else -axial
    force = jnp.stack(
        [-tangential * cosine - radial * sine, tangential * sine - radial * cosine, along], axis=-1
    )
    return force * chip.contact[..., None]


def _drill_chip(cutter: Cutter, cut: Cut, tool: Tool) -> Chip:
    angle = jnp.asarray(cut.angle_rad)[..., None, None] - cutter.lag_rad
    feed_m = jnp.asarray(cut.feed_per_revolution_m())[..., None, None]
    even = feed_m / tool.teeth + jnp.zeros_like(angle)
    across = jnp.full_like(angle, 0.5 * jnp.pi)  # where a chip is as thick as what is fed
    bare = even if cutter.even else carried_over(cutter, feed_m, across, cutter.radius_m)
    width = 0.5 * jnp.asarray(tool.diameter_m) + jnp.zeros_like(angle[..., :1])
    return Chip(angle, jnp.maximum(bare, 0.0), (bare >= 0.0).astype(angle.dtype), width)


def _turning_chip(cutter: Cutter, cut: Cut, tool: Tool) -> Chip:
    still = jnp.zeros_like(jnp.asarray(cut.angle_rad)[..., None, None] - cutter.lag_rad)
    feed_m = jnp.asarray(cut.feed_per_revolution_m())[..., None, None]
    width = jnp.asarray(cut.axial_width_m)[..., None, None]
    return Chip(still + 0.5 * jnp.pi, feed_m / tool.teeth + still, still + 1.0, width)
