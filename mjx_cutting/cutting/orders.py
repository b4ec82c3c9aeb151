"""The force of a steady cut as lines at multiples of the spindle frequency.

In a steady cut the force depends on the tool angle alone, so one revolution at K angles holds everything:
F(theta) = sum over n of c_n exp(i n theta), c_{-n} = conj(c_n). Structure and sensor multiply c_n by their
response at n f_s. Entry and exit are averaged over the angle step (`Cut.gate_rad`), so that the steps of the
edge force do not alias. Holds for effects without slow memory; where conditions drift, take one revolution
per segment.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect
from mjx_cutting.cutting.model import ForceModel


def revolution(model: ForceModel, cut: Cut, angles: int) -> Array:
    """[K, 3] process force at K even angles of one revolution, N; `cut.angle_rad` shifts the first."""
    return model.process_force(_turn(cut, angles))


def order_lines(model: ForceModel, cut: Cut, orders: int, angles: int) -> Array:
    """[orders + 1, 3] complex coefficients c_n of the SENSED force, n = 0..orders, N.

    The time record is Re(c_0 + 2 sum over n >= 1 of c_n exp(i n theta)).

    Arguments:
        model: force model; its effects are all `steady`.
        cut: scalar conditions.
        orders: highest order n kept, below `angles` / 2.
        angles: angles K evaluated; a multiple of the teeth, several times `orders`.
    """
    turn = _turn(cut, angles)
    lines = jnp.fft.rfft(model.process_force(turn), axis=0)
    if any(type(effect).sense is not AbstractEffect.sense for effect in model.effects):
        wave = jnp.fft.irfft(_responded(model, cut, lines), angles, axis=0)
        return jnp.fft.rfft(model.sense(wave, turn), axis=0)[: orders + 1] / angles
    return _responded(model, cut, lines[: orders + 1]) / angles


def _turn(cut: Cut, angles: int) -> Cut:
    step = 2.0 * jnp.pi / angles
    angle = cut.angle_rad + step * jnp.arange(angles)
    return cut.replace(angle_rad=angle, gate_rad=jnp.maximum(cut.gate_rad, step))


def _responded(model: ForceModel, cut: Cut, lines: Array) -> Array:
    response = model.transfer(jnp.arange(lines.shape[0]) * cut.spindle_speed_rev_s, cut)
    return jnp.einsum("nij,nj->ni", response, lines)
