"""The sheet as a height field along the path, cut away by the saw's circle.

Heights are relative to the true surface (0 is uncut, minus the thickness is air). A saw whose lowest point is
at height z and path position s leaves under it the profile z + R - sqrt(R^2 - (x - s)^2); each cell keeps the
lower of its height and that profile, so the removed area is the change of the field itself: volume is
conserved by construction, and cutting over a finished cut removes nothing. Only a window of cells around the
saw can change within a policy step; it is taken out once and put back once.

The depth that the teeth meet is that of the material AHEAD: the highest cell that the front of the circle
reaches. Breaks when the sheet bends, or when a burr or chip fills the cut again.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import ArrayLike

from mjx_cutting.sim.config import EnvConfig
from mjx_cutting.sim.vectors import Scalar

WINDOW_M = 0.040
"""Room for the chord of a cut 8 mm deep with a 50 mm saw, and for the way of a policy step."""


class Engagement(NamedTuple):
    """What the saw meets.

    Fields: `depth_m` of the material ahead below its surface (0: none); `entry_rad`, `exit_rad` of the arc,
    clockwise from the normal into the sheet; `contact` 1 where the arc is not empty, else 0.
    """

    depth_m: Scalar
    entry_rad: Scalar
    exit_rad: Scalar
    contact: Scalar


class Workpiece:
    """Geometry of the field (static); the heights themselves are part of the state."""

    def __init__(self, config: EnvConfig):
        self.cell_m = config.cell_m
        self.radius_m = config.radius_m
        self.kerf_m = config.kerf_m
        self.sheet_start_m = config.approach_m
        self.sheet_end_m = config.path_m
        self.window = 2 * round(0.5 * WINDOW_M / config.cell_m)
        margin = self.window
        self.origin_m = -margin * config.cell_m
        self.cells = round(config.path_m / config.cell_m) + 2 * margin
        centres = self.origin_m + (np.arange(self.cells) + 0.5) * config.cell_m
        self.material = (centres > self.sheet_start_m) & (centres < self.sheet_end_m)

    def fresh(self, thickness_m: ArrayLike) -> Array:
        """[cells] heights of an uncut sheet, m."""
        return jnp.where(jnp.asarray(self.material), 0.0, -jnp.asarray(thickness_m))

    def window_at(self, along_m: Array) -> Array:
        """[] first cell of the window around path position `along_m`."""
        first = jnp.floor((along_m - self.origin_m) / self.cell_m).astype(jnp.int32) - self.window // 2
        return jnp.clip(first, 0, self.cells - self.window)

    def take(self, heights: Array, first: Array) -> tuple[tuple[Array, ...], Array]:
        """Heights of the window's cells, one scalar each, and the path position of the first one's centre."""
        part = lax.dynamic_slice(heights, (first,), (self.window,))
        centre = self.origin_m + (first.astype(float) + 0.5) * self.cell_m
        return tuple(part[i] for i in range(self.window)), centre

    def put(self, heights: Array, part: tuple[Scalar, ...], first: Array) -> Array:
        """[cells] heights with the window put back."""
        return lax.dynamic_update_slice(heights, jnp.stack([jnp.asarray(h) for h in part]), (first,))

    def meet(
        self,
        part: tuple[Scalar, ...],
        first_m: Scalar,
        along_m: Scalar,
        height_m: Scalar,
        thickness_m: Scalar,
    ) -> Engagement:
        """What a saw with its lowest point at path position `along_m` and height `height_m` meets."""
        depth: Scalar = 0.0
        for cell, tall in enumerate(part):
            ahead = first_m + cell * self.cell_m - along_m
            above = tall - height_m
            near = jnp.maximum(ahead - self.cell_m, 0.0)
            reached = (ahead > -0.5 * self.cell_m) & (near * near <= above * (2.0 * self.radius_m - above))
            depth = jnp.maximum(depth, jnp.where(reached, above, 0.0))
        leave = _arc(depth / self.radius_m)
        start = _clip((self.sheet_start_m - along_m) / self.radius_m)
        end = _clip((self.sheet_end_m - along_m) / self.radius_m)
        entry = jnp.maximum(_arcsin(start), _arc((-thickness_m - height_m) / self.radius_m))
        leave = jnp.minimum(leave, _arcsin(end))
        contact = (depth > 0.0) & (leave > entry)
        return Engagement(depth, entry, jnp.maximum(leave, entry), jnp.where(contact, 1.0, 0.0))

    def remove(
        self,
        part: tuple[Scalar, ...],
        first_m: Scalar,
        along_m: Scalar,
        height_m: Scalar,
        thickness_m: Scalar,
    ) -> tuple[tuple[Scalar, ...], Scalar]:
        """The window after the saw's circle has cut it, and the area removed, m^2."""
        after = []
        removed: Scalar = 0.0
        for cell, tall in enumerate(part):
            apart = first_m + cell * self.cell_m - along_m
            under = self.radius_m**2 - apart * apart
            profile = height_m + self.radius_m - jnp.sqrt(jnp.maximum(under, 0.0))
            lower = jnp.minimum(tall, jnp.maximum(profile, -thickness_m))
            low = jnp.where(under > 0.0, lower, tall)
            removed = removed + (tall - low)
            after.append(low)
        return tuple(after), removed * self.cell_m


def _clip(ratio: Scalar) -> Scalar:
    return jnp.clip(ratio, 0.0, 1.0)


def _arc(ratio: Scalar) -> Scalar:
    """acos(1 - ratio) with ratio clipped to [0, 1], accurate near 0."""
    return 2.0 * _arcsin(jnp.sqrt(0.5 * _clip(ratio)))


def _arcsin(sine: Scalar) -> Scalar:
    return jnp.arcsin(sine)
