"""What the tool is doing at an instant: everything the force path may read, in SI units.

A record over time is the same object with a time axis in front of every field that changes.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jax.typing import ArrayLike

from mjx_cutting.cutting.engagement import arc


class Cut(eqx.Module):
    """The conditions of cutting; every field broadcasts to a common shape [...].

    Fields:
        angle_rad: angle of tooth 0, clockwise from +y (the normal into the sheet).
        spindle_speed_rev_s: spindle speed in REVOLUTIONS per second.
        feed_speed_m_s: speed of the tool along +x.
        radial_depth_m: depth of cut a, m.
        axial_width_m: width of cut b along the tool axis, m.
        entry_rad, exit_rad: engagement arc (see `arc`).
        position_m: distance along the path, m.
        cut_length_m: length this tool has cut since it was sharp, m.
        time_s: time since the trial began, s.
        clock_s: time since the sensor was zeroed, s.
        gate_rad: angle over which entry and exit of a tooth are averaged; 0 is sharp.
        vibration_x_m_s, vibration_y_m_s: rate at which the tool leaves its nominal path, m/s.
        gravity_x_m_s2, gravity_y_m_s2, gravity_z_m_s2: gravity less the tool's own acceleration, m/s^2.
        joint_velocity_rad_s: velocity of the joint that carries the feed, rad/s.
        feed_deviation_m_s: measured less nominal feed speed, m/s.
        angle_holds_ripple: 1 where `angle_rad` was measured so finely that it holds what is uneven within a
            turn, 0 where it is that of a spindle turning evenly.
        sheet: number of the material cut, where a model knows of several (`AbstractEffect.constants`); 0 is
            the model's own.

    The seven before the last two are covariates that only some effects read; zero where nobody measured them.
    """

    angle_rad: ArrayLike
    spindle_speed_rev_s: ArrayLike
    feed_speed_m_s: ArrayLike
    radial_depth_m: ArrayLike
    axial_width_m: ArrayLike
    entry_rad: ArrayLike
    exit_rad: ArrayLike
    position_m: ArrayLike = 0.0
    cut_length_m: ArrayLike = 0.0
    time_s: ArrayLike = 0.0
    clock_s: ArrayLike = 0.0
    gate_rad: ArrayLike = 0.0
    vibration_x_m_s: ArrayLike = 0.0
    vibration_y_m_s: ArrayLike = 0.0
    gravity_x_m_s2: ArrayLike = 0.0
    gravity_y_m_s2: ArrayLike = 0.0
    gravity_z_m_s2: ArrayLike = 0.0
    joint_velocity_rad_s: ArrayLike = 0.0
    feed_deviation_m_s: ArrayLike = 0.0
    angle_holds_ripple: ArrayLike = 0.0
    sheet: ArrayLike = 0.0

    @classmethod
    def milling(
        cls,
        milling: str,
        diameter_m: ArrayLike,
        *,
        angle_rad: ArrayLike,
        spindle_speed_rev_s: ArrayLike,
        feed_speed_m_s: ArrayLike,
        radial_depth_m: ArrayLike,
        axial_width_m: ArrayLike,
        **rest: Any,
    ) -> Cut:
        """A cut whose engagement arc follows from the kind of milling ("slot", "conventional" or "climb")."""
        entry, exit_ = arc(milling, radial_depth_m, diameter_m)
        return cls(
            angle_rad,
            spindle_speed_rev_s,
            feed_speed_m_s,
            radial_depth_m,
            axial_width_m,
            entry,
            exit_,
            **rest,
        )

    def replace(self, **changes: Any) -> Cut:
        """The same cut with some fields changed."""
        names = tuple(changes)
        return eqx.tree_at(
            lambda cut: [getattr(cut, name) for name in names],
            self,
            list(changes.values()),
            is_leaf=lambda leaf: leaf is None,
        )

    def feed_per_revolution_m(self) -> ArrayLike:
        """[...] v / f, m; zero where the tool backs away."""
        speed = jnp.maximum(jnp.asarray(self.spindle_speed_rev_s), 1e-9)
        return jnp.maximum(jnp.asarray(self.feed_speed_m_s), 0.0) / speed
