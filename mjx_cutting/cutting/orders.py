"""The force of a steady cut as lines at multiples of the spindle frequency.

In a steady cut the force depends on the tool angle alone, so one revolution holds everything: F(theta) = sum
over n of c_n exp(i n theta), c_{-n} = conj(c_n). Structure and sensor multiply c_n by their response at n
f_s. Holds for effects without slow memory; where conditions drift, take one revolution per segment.

Two ways to c_n. Where every tooth sweeps the same arc, its force is integrated over that arc alone by Gauss
and Legendre's rule, and the tooth's place on the tool is a factor exp(-i n lag): exact at entry and exit,
smooth in every parameter, and nothing is evaluated out of cut, which for a saw is nearly everywhere. A tooth
that starts to touch within the arc counts, there, with the share of the node's cell in which it does; where
an effect says at what angle that is (`AbstractEffect.arcs`), the arc is swept in parts, exact at their ends.
Otherwise the revolution is evaluated at even angles, entry and exit averaged over the angle step
(`Cut.gate_rad`), so that the steps of the edge force do not alias.
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.drilling import lever_m
from mjx_cutting.cutting.effects.abstract import AbstractEffect
from mjx_cutting.cutting.model import ForceModel

_NODES_PER_RADIAN = 0.35
_FEWEST_NODES = 32
_FINER = 8
_POWERS = 10
_FEWEST_OF_TORQUE = 128
_OF_TORQUE_PER_TOOTH = 32


def revolution(model: ForceModel, cut: Cut, angles: int) -> Array:
    """[K, 3] process force at K even angles of one revolution, N; `cut.angle_rad` shifts the first."""
    return model.process_force(_turn(cut, angles))


def order_lines(
    model: ForceModel,
    cut: Cut,
    orders: int,
    angles: int,
    arc_rad: float = np.pi,
    along: tuple[ArrayLike, ArrayLike] | None = None,
    only: Array | None = None,
) -> Array:
    """[orders + 1, 3] complex coefficients c_n of the SENSED force, n = 0..orders, N.

    The time record is Re(c_0 + 2 sum over n >= 1 of c_n exp(i n theta)), theta counted from `cut.angle_rad`.

    Arguments:
        model: force model; its effects are all `steady`.
        cut: scalar conditions.
        orders: highest order n kept, below `angles` / 2.
        angles: angles K of a revolution, where one is evaluated; a multiple of the teeth, several times
            `orders`.
        arc_rad: longest engagement arc there will be, which sets the accuracy of the rule over it.
        along: places [P] along the path, m, and the share [P] of each, where the response changes on the way
            and its mean is wanted; default the cut's own place.
        only: [H] orders that are wanted, where most are not: the others are then zero.
    """
    nodes = _nodes(orders, arc_rad)
    model = swung(model, cut, orders, angles, arc_rad)
    senses = any(type(effect).sense is not AbstractEffect.sense for effect in model.effects)
    wanted = jnp.arange(orders + 1) if only is None else only
    # a sensor that acts on the wave needs all of its lines
    if model.turns_evenly:
        order = jnp.arange(orders + 1) if senses else wanted
        lines = _in_parts(model, cut, order, orders, nodes)
        if any(type(effect).body is not AbstractEffect.body for effect in model.effects):
            lines = lines + jnp.fft.rfft(model.body_force(_turn(cut, angles)), axis=0)[order] / angles
    else:
        every = jnp.fft.rfft(model.process_force(_turn(cut, angles)), axis=0) / angles
        order = jnp.arange(len(every)) if senses else wanted
        lines = every[order]
    lines = _responded(model, cut, order, lines, along)
    if senses:
        wave = jnp.fft.irfft(lines * angles, angles, axis=0)
        lines = jnp.fft.rfft(model.sense(wave, _turn(cut, angles)), axis=0)[wanted] / angles
    return lines if only is None else jnp.zeros((orders + 1, 3), lines.dtype).at[wanted].set(lines)


def swung(model: ForceModel, cut: Cut, orders: int, angles: int, arc_rad: float = np.pi) -> ForceModel:
    """The model whose effects know the torque of the turn, where one asks for it; arguments of
    `order_lines`."""
    if model.tool.kind not in ("end_mill", "slitting_saw"):
        return model
    # where a tooth enters or leaves the speed has a kink, and how far it is ahead there tells
    orders = max(orders, _FEWEST_OF_TORQUE, _OF_TORQUE_PER_TOOTH * model.tool.teeth)
    angles, nodes = max(angles, 4 * orders), _nodes(orders, arc_rad)
    effects, from_zero = list(model.effects), cut.replace(angle_rad=jnp.zeros_like(cut.angle_rad))
    for index, effect in enumerate(effects):
        if effect.swings:
            rest = ForceModel(model.tool, model.material, (*effects[:index], *effects[index + 1 :]))
            there = effect.spindle(from_zero, model)
            if rest.turns_evenly:
                every = jnp.arange(orders + 1)
                torque = _in_parts(rest, there, every, orders, nodes, of_torque=True)[:, 0]
            else:
                torque = jnp.fft.rfft(rest.torque_z(_turn(there, angles)))[: orders + 1] / angles
            effects[index] = effect.swung(torque, cut, model)
    return ForceModel(model.tool, model.material, tuple(effects))


def _nodes(orders: int, arc_rad: float) -> int:
    return _FEWEST_NODES + int(_NODES_PER_RADIAN * orders * arc_rad)


def _in_parts(
    model: ForceModel, cut: Cut, order: Array, orders: int, nodes: int, of_torque: bool = False
) -> Array:
    """[H, 3] lines over time of the edges' force at the orders `order` [H], none above `orders`, or [H, 1]
    `of_torque` of theirs, each part of the arc from `nodes` angles."""
    bent = any(type(effect).engage is not AbstractEffect.engage for effect in model.effects)
    for effect in model.effects:
        parts = None if bent else effect.arcs(cut, model)
        if parts is not None:
            rest = ForceModel(model.tool, model.material, tuple(e for e in model.effects if e is not effect))
            each = (share * _in_parts(rest, part, order, orders, nodes, of_torque) for share, part in parts)
            return sum(each, jnp.zeros((len(order), 1 if of_torque else 3)))
    return _swept(model, cut, order, orders, nodes, of_torque)


def _swept(model: ForceModel, cut: Cut, order: Array, orders: int, nodes: int, of_torque: bool) -> Array:
    """[H, 3] lines over time of the edges' force, or [H, 1] of their torque, from `nodes` angles of the
    arc."""
    node, weight = np.polynomial.legendre.leggauss(nodes)
    force, own, lag, even = model.elements_in_arc(
        cut, jnp.asarray(0.5 + 0.5 * node), jnp.asarray(0.5 * weight)
    )
    share = weight * (own[-1] - own[0]) / (node[-1] - node[0]) / (2.0 * np.pi)
    if of_torque:
        x, y, there = force[..., :1], force[..., 1:2], own[:, None, None, None]
        torque = lever_m(model.tool) * (y * jnp.sin(there) - x * jnp.cos(there))
        return _transformed(own[:, None, None] + lag, torque * share[:, None, None, None], orders)[order]
    if even is not None:
        value = force * (share[:, None, None] * even[1])[..., None]
        return _transformed(even[0] - cut.angle_rad, value, orders)[order]
    place = jnp.exp(-1j * order[:, None, None] * (lag - cut.angle_rad))
    if _alike(model):
        force, place = force[:, :, :1], jnp.sum(place, axis=2, keepdims=True)
    turn = order[:, None] * own
    over_arc = jnp.concatenate([jnp.cos(turn), -jnp.sin(turn)]) * share
    parts = jnp.matmul(over_arc, force.reshape(nodes, -1), precision="highest")
    parts = parts.reshape(2, len(order), *force.shape[1:])
    return jnp.einsum("nsj,nsja->na", place, jax.lax.complex(parts[0], parts[1]))


def _transformed(angle: Array, value: Array, orders: int) -> Array:
    """[orders + 1, A] sums of `value` [K, S, N, A] exp(-i n angle), `angle` [K, S, N], relative error 1e-11.

    An angle is the nearest of many even ones and a small rest. Over the even ones the sums are a fast Fourier
    transform; the rest counts by its powers (Anderson and Dahleh, SIAM J. Sci. Comput. 17, 1996).
    """
    most = max(orders, 1)
    angles = _FINER * 2 ** math.ceil(math.log2(most + 1))
    step = 2.0 * jnp.pi / angles
    turned = angle.reshape(-1) / step
    nearest = jax.lax.stop_gradient(jnp.round(turned))
    rest = most * step * (turned - nearest)
    axes = value.shape[-1]
    powers = [value.reshape(-1, axes)]
    for q in range(1, _POWERS):
        powers.append(powers[-1] * (rest / q)[:, None])
    even = jnp.zeros((angles, axes * _POWERS), value.dtype)
    even = even.at[nearest.astype(int) % angles].add(jnp.concatenate(powers, axis=1))
    each = jnp.fft.rfft(even, axis=0)[: orders + 1].reshape(orders + 1, _POWERS, axes)
    share = (-1j * np.arange(orders + 1)[:, None] / most) ** np.arange(_POWERS)
    return jnp.einsum("nq,nqa->na", jnp.asarray(share, each.dtype), each)


def _alike(model: ForceModel) -> bool:
    """Whether every tooth carries the same force at the same angle."""
    hooks = ("chip", "edge")
    return model.cutter().even and not any(
        getattr(type(effect), hook) is not getattr(AbstractEffect, hook)
        for effect in model.effects
        if not effect.alike
        for hook in hooks
    )


def _turn(cut: Cut, angles: int) -> Cut:
    step = 2.0 * jnp.pi / angles
    angle = cut.angle_rad + step * jnp.arange(angles)
    return cut.replace(angle_rad=angle, gate_rad=jnp.maximum(cut.gate_rad, step))


def _responded(
    model: ForceModel,
    cut: Cut,
    order: Array,
    lines: Array,
    along: tuple[ArrayLike, ArrayLike] | None = None,
) -> Array:
    """The `lines` [H, 3] at the orders `order` [H] as structure and sensor respond to them."""
    frequency = order * cut.spindle_speed_rev_s
    if along is None:
        response = model.transfer(frequency, cut)
    else:
        places, share = along
        each = jax.vmap(lambda place: model.transfer(frequency, cut.replace(position_m=place)))(
            jnp.asarray(places)
        )
        response = jnp.tensordot(jnp.asarray(share), each, axes=1)
    return jnp.einsum("nij,nj->ni", response, lines)
