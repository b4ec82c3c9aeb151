"""A speed that swings within the turn as the torque does: how far the tool is ahead of turning evenly.

With D(th) the speed's deviation from its mean over the angle, as a share of the mean f over time, the angle
phi of even turning goes as

    d phi / d th = 1 / (s + D),    mean of 1 / (s + D) = 1,    phi = th + u(th)

exactly, for a speed that answers at once. One that answers to first order, at a bandwidth f_b, has the order
n of D divided by 1 + i n f / f_b, counted along the angle: D is a few per cent, so time goes nearly as the
angle does.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.chip import Chip, edge_lags
from mjx_cutting.cutting.cut import Cut

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

_FINER = 4
_FEWEST = 256
_MOST = 0.5
_TIMES = 4


class Ahead(eqx.Module):
    """How far the tool is ahead at G even angles of even turning over a turn.

    Fields: `value` [G] rad; `slope` [G]; `excess` [] by what share of the mean speed over time that over the
    angle exceeds it.
    """

    value: Array
    slope: Array
    excess: Array

    def at(self, angle_rad: ArrayLike) -> Array:
        """[...] at other angles, rad."""
        return _between(self.value, self.slope, angle_rad).value


def chip_by_time(chip: Chip, cut: Cut, model: ForceModel, ahead_of: Callable[[Array], Array]) -> Chip:
    """The chips that follow from the time since the tooth before passed, `ahead_of` an angle being how far
    the tool is ahead of turning evenly there, to first order in it."""
    pitch, cutter = 2.0 * jnp.pi / model.tool.teeth, model.cutter()
    milling = model.tool.kind in ("end_mill", "slitting_saw")
    angle = chip.angle_rad + (edge_lags(cutter, cut, model.tool)[0] if milling else cutter.lag_rad)
    gained = ahead_of(angle) - ahead_of(angle - pitch)
    return chip._replace(thickness_m=chip.thickness_m * (1.0 - gained / pitch))


def ahead(deviation: Array, response: Array) -> Ahead:
    """How far the tool is ahead of turning evenly.

    Arguments:
        deviation: [n + 1] complex lines over the tool's angle of the speed's deviation, as a share of its
            mean over time, were it to answer at once: D = Re(2 sum over n >= 1 of D_n exp(i n th)); D_0 is
            not read.
        response: [n + 1] complex answer of the speed at each order.
    """
    highest = deviation.shape[0] - 1
    angles = max(_FEWEST, _FINER * 2 ** math.ceil(math.log2(highest + 1)))
    order = jnp.arange(angles // 2 + 1)
    answered = jnp.zeros(angles // 2 + 1, deviation.dtype).at[1 : highest + 1].set((deviation * response)[1:])
    answer = jnp.clip(jnp.fft.irfft(answered, angles) * angles, -_MOST, _MOST)
    mean = jnp.ones(())
    for _ in range(_TIMES):
        mean = jnp.mean(1.0 / (1.0 + answer / mean))
    rate = 1.0 / (mean + answer)
    gained = jnp.fft.rfft(rate) / (1j * jnp.maximum(order, 1))
    u, slope = jnp.fft.irfft(gained.at[0].set(0.0).at[-1].set(0.0), angles), rate - 1.0
    even = 2.0 * jnp.pi / angles * jnp.arange(angles)
    turned = even
    for _ in range(_TIMES):
        turned = even - _between(u, slope, turned).value
    there = _between(u, slope, turned).slope
    return Ahead(turned - even, -there / (1.0 + there), mean - 1.0)


class _Point(NamedTuple):
    value: Array
    slope: Array


def _between(value: Array, slope: Array, angle_rad: ArrayLike) -> _Point:
    """Value and slope at angles [...] of a periodic function known at even ones, by Hermite's cubics."""
    count = value.shape[0]
    step = 2.0 * jnp.pi / count
    place = jnp.asarray(angle_rad) / step
    first = jnp.floor(place)
    t = place - first
    i = first.astype(int) % count
    j = (i + 1) % count
    rise = value[j] - value[i]
    before, after = step * slope[i] - rise, rise - step * slope[j]
    found = value[i] + t * (rise + (1.0 - t) * ((1.0 - t) * before + t * after))
    moved = rise + (1.0 - 2.0 * t) * ((1.0 - t) * before + t * after) + t * (1.0 - t) * (after - before)
    return _Point(found, moved / step)
