"""Chip thickness under each edge, with carry-over of the surface that earlier teeth left.

Tooth j at angle th on radius R + r_j removes what the teeth before it left standing:

    h_j = max(0, min over m = 1..N of [ (advance since tooth j-m passed th) sin th + r_j - r_{j-m} ])

The advance is feed per revolution times the angle between the two teeth over 2 pi. With equal teeth this is
the textbook c sin th (Martellotti 1941, circular path: valid while the feed per tooth is small against R). A
tooth whose bracket is negative does not touch the sheet, so it rubs nothing either. Without carry-over a saw
with small chips would remove more than is fed.

On their true path teeth meet a surface that is curved, and left a little earlier or later than a circle would
have it: `fed`; and on the side of the cut the cusps that teeth leave there: `swept`.

Where the tool's centre moves within a turn, by u(angle of the tool) alike in every turn, a tooth reaches
u . (sin th, cos th) further, and r_j is a function of th.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from numpy.typing import NDArray

from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.engagement import inside
from mjx_cutting.cutting.tool import Tool

_CONTACT_SHARE = 0.02
_CONTACT_M = 1e-12
_NO_ARC_RAD = 1e-12
_AT_SIDE_RAD = 1e-6


class Cutter(NamedTuple):
    """Geometry of the teeth as the chip stage sees it.

    Fields:
        lag_rad: [N] angle of each tooth behind tooth 0, rad, increasing.
        radius_m: [N] deviation of each tooth's radius from the nominal, m.
        helix_rad: [] helix angle of the edges, rad.
        slices: axial slices per edge (static).
        even: True while all teeth are alike and evenly spaced (static: it saves the comparison over m).
        path: [K, 2] complex lines of the centre's motion in x and y at orders 1 to K of the tool's angle, m:
            u = Re(2 sum over n of path_n exp(i n angle)); None where it goes straight.
        curvature_1_m: [] curvature 1 / R of the surfaces that teeth leave, 1/m; None where they are taken as
            circles one beside the other.
        cusps: [] 1 where the edges meet the cusps on the side of the cut too, else 0; read with a curvature.
    """

    lag_rad: Array
    radius_m: Array
    helix_rad: Array
    slices: int
    even: bool
    path: Array | None = None
    curvature_1_m: Array | None = None
    cusps: ArrayLike = 0.0

    def gap_rad(self) -> Array:
        """[N] angle between each tooth and the one before it, rad."""
        gap = self.lag_rad - jnp.roll(self.lag_rad, 1)
        return gap.at[0].add(2.0 * jnp.pi)


class Chip(NamedTuple):
    """Chip under each edge element; the last two axes are axial slice S and tooth N.

    Fields:
        angle_rad: [..., S, N] angle of the edge element, rad.
        thickness_m: [..., S, N] uncut chip thickness h >= 0, m.
        contact: [..., S, N] share of the angle step in which the element touches the sheet, 0 to 1.
        width_m: [..., 1, 1] width of cut of one element, m.
    """

    angle_rad: Array
    thickness_m: Array
    contact: Array
    width_m: Array


def nominal_cutter(tool: Tool) -> Cutter:
    """The teeth as drawn: evenly spaced and equally long."""
    return Cutter(tool.pitch_rad, jnp.zeros(tool.teeth), jnp.asarray(tool.helix_rad), tool.slices, even=True)


def chip_under(cutter: Cutter, cut: Cut, tool: Tool) -> Chip:
    """Chip thickness and contact of every edge element of a mill or saw, [..., S, N]."""
    behind, width_m, height_lag = edge_lags(cutter, cut, tool)
    angle = jnp.asarray(cut.angle_rad)[..., None, None] - behind
    gate = jnp.maximum(jnp.asarray(cut.gate_rad)[..., None, None], jnp.abs(height_lag) / cutter.slices)
    entry, leave = (each[..., None, None] for each in swept(cutter, cut, tool))
    contact = inside(angle, entry, leave, gate)
    bare, advance_m = _bare(cutter, cut, tool, angle, behind)
    if not cutter.even:
        # towards the ends of the arc the chips of all teeth go to nothing, which is no tooth that runs idle
        ramp = jnp.maximum(gate * jnp.abs(jnp.cos(angle)), _CONTACT_SHARE * jnp.abs(jnp.sin(angle)))
        contact = jnp.minimum(contact, _begun(bare, 0.5, ramp * advance_m))
    return Chip(angle, jnp.maximum(bare, 0.0), contact, width_m)


def swept(cutter: Cutter, cut: Cut, tool: Tool) -> tuple[Array, Array]:
    """[...] entry and exit angle of the teeth, rad.

    Where the arc ends on the side of the cut, across the feed, teeth on their true path meet the cusps left
    there: as far as `fed` is above zero, sin th > -d / 2 R, d the advance since the surface was left, at most
    that of a whole turn.
    """
    entry, leave = jnp.asarray(cut.entry_rad), jnp.asarray(cut.exit_rad)
    if cutter.curvature_1_m is None:
        return entry, leave
    advance_m = jnp.asarray(cut.feed_per_revolution_m()) / (tool.teeth if cutter.even else 1)
    beyond = 0.5 * jnp.asarray(cutter.cusps) * cutter.curvature_1_m * advance_m
    at_entry, at_exit = entry < _AT_SIDE_RAD, leave > jnp.pi - _AT_SIDE_RAD
    return jnp.where(at_entry, entry - beyond, entry), jnp.where(at_exit, leave + beyond, leave)


def chip_in_arc(cutter: Cutter, cut: Cut, tool: Tool, own_rad: Array, cell_rad: Array) -> Chip:
    """The same, [K, S, N], with every edge element at its own angles `own_rad` [K], all inside the arc; each
    stands for what lies `cell_rad` [K, 2] before and after it."""
    behind, width_m, _ = edge_lags(cutter, cut, tool)
    angle = jnp.asarray(own_rad)[..., None, None] + jnp.zeros_like(behind)
    bare, _ = _bare(cutter, cut, tool, angle, behind)
    contact = jnp.ones_like(angle)
    if not cutter.even:
        before, after = jnp.moveaxis(jnp.asarray(cell_rad), -1, 0)[..., None, None]
        whole, slope = jnp.maximum(before + after, _NO_ARC_RAD), _slope(bare, angle)
        contact = _begun(bare, jnp.where(slope > 0.0, after, before) / whole, whole * jnp.abs(slope))
    return Chip(angle, jnp.maximum(bare, 0.0), contact, width_m)


def _bare(cutter: Cutter, cut: Cut, tool: Tool, angle: Array, behind: Array) -> tuple[Array, Array]:
    """[..., S, N] chip thickness, negative where a tooth does not reach the sheet, m; and how far the tool
    has advanced since the surface that the tooth meets was left, m."""
    feed_m = jnp.asarray(cut.feed_per_revolution_m())[..., None, None]
    if cutter.even:
        each_m = feed_m / tool.teeth
        return fed(cutter, each_m, feed_m, angle), each_m
    passes = cutter.lag_rad.shape[0]
    of_each = left_standing(cutter, feed_m, angle, _reach(cutter, angle, behind), passes)
    first = jnp.argmin(of_each, axis=-1)[..., None] == jnp.arange(passes)
    apart = jnp.sum(jnp.where(first, earlier_passes(cutter, passes)[1], 0.0), axis=-1)
    return least(of_each), feed_m * (apart / (2.0 * np.pi))


def _begun(bare_m: Array, share: ArrayLike, ramp_m: Array) -> Array:
    """Share of contact of an element of unclipped chip thickness `bare_m`, which changes by `ramp_m` over
    what the element stands for, a `share` of that on the side where the chip is thicker."""
    return jnp.clip(share + (bare_m + _CONTACT_M) / (ramp_m + _CONTACT_M), 0.0, 1.0)


def _slope(bare: Array, angle: Array) -> Array:
    """[K, S, N] how the chip changes with the angle along the arc, m/rad."""
    rise = jnp.concatenate([bare[:1], bare, bare[-1:]])
    run = jnp.concatenate([angle[:1], angle, angle[-1:]])
    return (rise[2:] - rise[:-2]) / jnp.maximum(run[2:] - run[:-2], _NO_ARC_RAD)


def touching(bare_m: Array, feed_per_tooth_m: Array) -> Array:
    """[...] share of contact of an element of unclipped chip thickness `bare_m`: 0 once it runs idle."""
    ramp = _CONTACT_SHARE * feed_per_tooth_m + _CONTACT_M
    return jnp.clip(1.0 + bare_m / ramp, 0.0, 1.0)


def edge_lags(cutter: Cutter, cut: Cut, tool: Tool) -> tuple[Array, Array, Array]:
    """Angle of each element behind tooth 0's tip [..., S, N], width of one [..., 1, 1], whole lag [..., 1,
    1]."""
    width = jnp.asarray(cut.axial_width_m)[..., None, None]
    lag = 2.0 * width * jnp.tan(cutter.helix_rad) / jnp.asarray(tool.diameter_m)
    share = ((jnp.arange(cutter.slices) + 0.5) / cutter.slices)[:, None]
    return cutter.lag_rad + lag * share, width / cutter.slices, lag


def _reach(cutter: Cutter, angle: Array, behind: Array) -> Array:
    """[N] or [..., S, N] how far each tooth reaches beyond the nominal radius at its own `angle`, m."""
    if cutter.path is None:
        return cutter.radius_m
    order = jnp.arange(1, cutter.path.shape[0] + 1)
    shift = 2.0 * jnp.real(jnp.exp(1j * (angle + behind)[..., None] * order) @ cutter.path)
    return cutter.radius_m + shift[..., 0] * jnp.sin(angle) + shift[..., 1] * jnp.cos(angle)


def fed(cutter: Cutter, advance_m: Array, feed_m: Array, angle: Array) -> Array:
    """[...] thickness between the path of a tooth at `angle` and that of one that passed while the tool
    advanced by `advance_m`, of `feed_m` a revolution, m.

    On the true path the earlier tooth was there by d cos th / R of its turn later, so that the tool advanced
    by d = advance / (1 + feed cos th / (2 pi R)), and h = d sin th + (d cos th)^2 / 2 R: Martellotti, Trans.
    ASME 63 (1941) 677-700, to second order in d / R (`benchmarks/tooth_path.py` has what that leaves).
    """
    if cutter.curvature_1_m is None:
        return advance_m * jnp.sin(angle)
    cosine = jnp.cos(angle)
    advance_m = advance_m / (1.0 + cutter.curvature_1_m * feed_m * cosine / (2.0 * jnp.pi))
    return advance_m * jnp.sin(angle) + 0.5 * cutter.curvature_1_m * (advance_m * cosine) ** 2


def carried_over(cutter: Cutter, feed_m: Array, angle: Array, reach_m: Array) -> Array:
    """[..., S, N] chip from the teeth's reach [N] or [..., S, N], m: the least of what each of the N passes
    before left."""
    return least(left_standing(cutter, feed_m, angle, reach_m, cutter.lag_rad.shape[0]))


@jax.custom_jvp
def least(of_each: Array) -> Array:
    """[...] the least of [..., M]. Its derivative is that of the first one that is least: JAX's own compares
    each with the least, and where a compiler calculates them twice, rounded otherwise, is not a number."""
    return jnp.min(of_each, axis=-1)


@least.defjvp
def _least_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    (of_each,), (change,) = primals, tangents
    first = jnp.argmin(of_each, axis=-1)[..., None] == jnp.arange(of_each.shape[-1])
    return least(of_each), jnp.sum(jnp.where(first, change, 0.0), axis=-1)


def left_standing(cutter: Cutter, feed_m: Array, angle: Array, reach_m: Array, passes: int) -> Array:
    """[..., S, N, M] what each of the M = `passes` before left for a tooth, m: what is `fed` between the two
    + r_j - r_{j-m}, r the teeth's reach."""
    before, apart = earlier_passes(cutter, passes)
    step = reach_m[..., None] - reach_m[..., before]
    feed_m, angle = feed_m[..., None], angle[..., None]
    return fed(cutter, feed_m * (apart / (2.0 * np.pi)), feed_m, angle) + step


def earlier_passes(cutter: Cutter, passes: int) -> tuple[NDArray[np.int64], Array]:
    """[N, M] which tooth cut m = 1..M passes before each, and the angle between the two, rad."""
    tooth, m = np.arange(cutter.lag_rad.shape[0])[:, None], np.arange(1, passes + 1)
    before = (tooth - m) % len(tooth)
    turns = (before - tooth + m) // len(tooth)
    return before, cutter.lag_rad[:, None] - cutter.lag_rad[before] + 2.0 * np.pi * turns
