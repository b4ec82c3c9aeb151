"""The force path: a base mechanistic model and a tuple of effects, from spindle angle to sensed force.

One edge element of width db carries f = db (k_e + k_c h), h its chip thickness; the force on the tool is the
sum over elements, turned into the process frame:

    dFx = -Ft cos - Fr sin,   dFy = Ft sin - Fr cos,   dFz = -Fa

(Altintas, Manufacturing Automation, 2nd ed. (2012), eq. 2.81 ff.; angle clockwise from +y, so x is the feed
and y points into the sheet for conventional cutting.) Drills and turning tools: see `drilling`. Everything
here is a pure function of arrays.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.chip import Chip, Cutter, chip_in_arc, edge_lags, nominal_cutter, swept
from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.drilling import elements_to_process, engaged_chip, lever_m, to_process
from mjx_cutting.cutting.effects.abstract import STAGES, AbstractEffect, EdgeForce
from mjx_cutting.cutting.effects.registry import effect_class
from mjx_cutting.cutting.material import Material
from mjx_cutting.cutting.tool import Tool

FORMAT = "mjx-cutting-model/1"


class ForceModel(eqx.Module):
    """Base model plus effects.

    Fields:
        tool: the cutter.
        material: mechanistic constants.
        effects: what the base model lacks; effects compose in the order of the path, then of the tuple.
    """

    tool: Tool
    material: Material
    effects: tuple[AbstractEffect, ...] = ()

    def process_force(self, cut: Cut) -> Array:
        """[..., 3] force ON THE TOOL in the process frame, N, before structure and sensor."""
        return self._engaged_force(self._engaged(cut))

    def torque_z(self, cut: Cut) -> Array:
        """[...] torque that resists the spindle, N m, >= 0 where the edges cut."""
        cut = self._engaged(cut)
        chip = self.chip(cut)
        edge = self.edge_force(chip, cut)
        torque = jnp.sum((edge.chip + edge.edge)[..., 0] * chip.contact, axis=(-2, -1)) * lever_m(self.tool)
        for effect in self._path():
            torque = effect.brake(torque, cut, self)
        return torque

    def cutter(self) -> Cutter:
        """Where the teeth really are."""
        cutter = nominal_cutter(self.tool)
        for effect in self._path():
            cutter = effect.cutter(cutter, self)
        return cutter

    def chip(self, cut: Cut) -> Chip:
        """Chip thickness and contact under each edge element, [..., S, N]."""
        return self._affected(engaged_chip(self.cutter(), cut, self.tool), cut)

    def elements_in_arc(
        self, cut: Cut, share: Array, cell: Array
    ) -> tuple[Array, Array, Array, tuple[Array, Array] | None]:
        """Process force of every edge element where it is in the arc, for mills and saws that `turn_evenly`.

        Arguments:
            cut: scalar conditions.
            share: [K] places in the engagement arc, 0 at entry, 1 at exit.
            cell: [K] share of the arc that each place stands for.

        Returns:
            [K, S, N, 3] force of each element, N; [K] its own angle there, rad; [S, N] its lag: the tool
            stands at own angle plus lag; None where the tool turns evenly, else [K, S, N] the angle it would
            have had by then, rad, and the rate of that angle against its own.
        """
        cut = self._engaged(cut)
        cutter = self.cutter()
        entry, leave = swept(cutter, cut, self.tool)
        arc_rad = leave - entry
        own = entry + arc_rad * share
        beyond = jnp.cumsum(cell) - share
        cells = arc_rad * jnp.stack([cell - beyond, beyond], axis=-1)
        chip = self._affected(chip_in_arc(cutter, cut, self.tool, own, cells), cut)
        local = self.edge_force(chip, cut)
        lag = edge_lags(cutter, cut, self.tool)[0]
        force = elements_to_process(local.chip + local.edge, chip, self.tool)
        return force, own, lag, self._even_turn(own[:, None, None] + lag, cut)

    def _even_turn(self, angle: Array, cut: Cut) -> tuple[Array, Array] | None:
        if all(effect.ahead(angle) is None for effect in self.effects):
            return None

        def ahead(angle: Array) -> Array:
            gains = [effect.ahead(angle) for effect in self.effects]
            gained = sum((gain for gain in gains if gain is not None), jnp.zeros_like(angle))
            return gained * (1.0 - jnp.asarray(cut.angle_holds_ripple))

        even = angle - ahead(angle - ahead(angle))
        rate = jax.jvp(ahead, (even,), (jnp.ones_like(even),))[1]
        return even, 1.0 / (1.0 + rate)

    @property
    def turns_evenly(self) -> bool:
        """Whether every tooth of a mill or saw sweeps one arc, at a speed even but for `ahead`."""
        hooks = ("spindle", "engage")
        return self.tool.kind in ("end_mill", "slitting_saw") and not any(
            getattr(type(effect), hook) is not getattr(AbstractEffect, hook)
            for effect in self.effects
            if not effect.per_turn
            for hook in hooks
        )

    def body_force(self, cut: Cut) -> Array:
        """[..., 3] forces on the tool as a whole, without those of the edges, N."""
        force = jnp.zeros((*jnp.shape(cut.angle_rad), 3))
        for effect in self._path():
            force = effect.body(force, cut, self)
        return force

    def _affected(self, chip: Chip, cut: Cut) -> Chip:
        for effect in self._path():
            chip = effect.chip(chip, cut, self)
        return chip

    def edge_force(self, chip: Chip, cut: Cut) -> EdgeForce:
        """[..., S, N, 3] local force on each edge element in full contact, N."""
        width, material = chip.width_m[..., None], self.material
        for effect in self._path():
            material = effect.constants(material, cut, self)
        local = EdgeForce(
            chip=width * chip.thickness_m[..., None] * material.chip_n_m2[..., None, None, :],
            edge=width * jnp.ones_like(chip.thickness_m)[..., None] * material.edge_n_m[..., None, None, :],
        )
        for effect in self._path():
            local = effect.edge(local, chip, cut, self)
        return local

    def sense(self, force: Array, cut: Cut) -> Array:
        """[..., 3] the memoryless part of structure and sensor."""
        for effect in self._path():
            force = effect.sense(force, cut, self)
        return force

    def transfer(self, frequency_hz: ArrayLike, cut: Cut) -> Array:
        """[F, 3, 3] complex response of structure and sensor to a steady line at each frequency, Hz."""
        frequency = jnp.atleast_1d(jnp.asarray(frequency_hz))
        total = None
        for effect in self._path():
            own = effect.transfer(frequency, cut, self)
            if own is not None:
                # term by term: a product of matrices this small costs more than its terms
                total = own if total is None else jnp.sum(own[..., None] * total[..., None, :, :], axis=-2)
        whole = jnp.eye(3) if total is None else total
        return jnp.broadcast_to(whole, (*frequency.shape, 3, 3)).astype(jnp.result_type(frequency, 1j))

    def init(self) -> tuple[Any, ...]:
        """Memory of every effect at rest, a pytree."""
        return tuple(effect.init(self) for effect in self.effects)

    def respond(
        self, state: tuple[Any, ...], force: Array, cut: Cut, dt_s: ArrayLike
    ) -> tuple[tuple[Any, ...], Array]:
        """Pass the process force [3] of one instant on to the sensor, advancing memory by `dt_s`."""
        after = list(state)
        for index in self._order():
            after[index], force = self.effects[index].respond(state[index], force, cut, dt_s, self)
        return tuple(after), self.sense(force, cut)

    def recall(self, state: tuple[Any, ...], cut: Cut, dt_s: ArrayLike) -> ForceModel:
        """The model with the memory of coupled effects bound, to compute the force of one instant."""
        bound = (e.recall(s, cut, dt_s, self) for e, s in zip(self.effects, state, strict=True))
        return ForceModel(self.tool, self.material, tuple(bound))

    def step(
        self, state: tuple[Any, ...], cut: Cut, dt_s: ArrayLike, samples: int = 8
    ) -> tuple[tuple[Any, ...], Array, Array]:
        """One simulation sub-step: the force averaged over the tool angles that pass within it.

        Arguments:
            state: memory from `init` or the last step.
            cut: scalar conditions at the START of the step.
            dt_s: [] length of the step, s.
            samples: tool angles evaluated inside the step.

        Returns:
            state, process force [3] that acts on the robot, sensed force [3], both N, both means over the
            step.
        """
        share = (jnp.arange(samples) + 0.5) / samples
        turn = 2.0 * jnp.pi * jnp.asarray(cut.spindle_speed_rev_s) * dt_s
        advance = jnp.asarray(cut.feed_speed_m_s) * dt_s * share
        inside = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (samples,)), cut).replace(
            angle_rad=cut.angle_rad + turn * share,
            time_s=cut.time_s + dt_s * share,
            clock_s=cut.clock_s + dt_s * share,
            position_m=cut.position_m + advance,
            cut_length_m=cut.cut_length_m + advance,
            gate_rad=jnp.broadcast_to(jnp.maximum(cut.gate_rad, turn / samples), (samples,)),
        )
        state, force, sensed = self._run(state, inside, dt_s / samples)
        return state, force.mean(axis=0), sensed.mean(axis=0)

    def predict(self, cut: Cut, dt_s: ArrayLike) -> Array:
        """[T, 3] sensed force over a record, N.

        Arguments:
            cut: conditions with a leading time axis [T] in `angle_rad`; other fields broadcast.
            dt_s: [] sampling interval, s; it must resolve tooth passing and the fastest response of an
            effect.
        """
        length = jnp.shape(cut.angle_rad)[0]
        record = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (length,)), cut)
        return self._run(self.init(), record, dt_s)[2]

    def _run(
        self, state: tuple[Any, ...], record: Cut, dt_s: ArrayLike
    ) -> tuple[tuple[Any, ...], Array, Array]:
        """State after a record [T], process force and sensed force [T, 3]; each sample stands for `dt_s`."""
        if any(effect.coupled for effect in self.effects):

            def instant(memory: Any, cut: Cut) -> tuple[Any, tuple[Array, Array]]:
                bound = self.recall(memory, cut, dt_s)
                force = bound.process_force(cut)
                memory, sensed = bound.respond(memory, force, cut, dt_s)
                return memory, (force, sensed)

            state, (force, sensed) = jax.lax.scan(instant, state, record)
            return state, force, sensed
        force = self.process_force(record)
        if not jax.tree.leaves(state):
            return state, force, self.sense(force, record)

        def one(memory: Any, each: tuple[Array, Cut]) -> tuple[Any, Array]:
            return self.respond(memory, each[0], each[1], dt_s)

        state, sensed = jax.lax.scan(one, state, (force, record))
        return state, force, sensed

    def _order(self) -> list[int]:
        """Indices of the effects in the order of the path, then of the tuple."""
        return sorted(range(len(self.effects)), key=lambda index: STAGES.index(self.effects[index].stage))

    def _path(self) -> list[AbstractEffect]:
        return [self.effects[index] for index in self._order()]

    def _engaged(self, cut: Cut) -> Cut:
        """The cut as spindle and structure leave it."""
        for effect in self._path():
            cut = effect.spindle(cut, self)
        for effect in self._path():
            cut = effect.engage(cut, self._engaged_force, self)
        return cut

    def _engaged_force(self, cut: Cut) -> Array:
        chip = self.chip(cut)
        local = self.edge_force(chip, cut)
        force = to_process(local.chip + local.edge, chip, self.tool)
        for effect in self._path():
            force = effect.body(force, cut, self)
        return force

    def with_effects(self, *effects: AbstractEffect) -> ForceModel:
        """The same model with more effects."""
        return ForceModel(self.tool, self.material, (*self.effects, *effects))

    def to_dict(self) -> dict[str, Any]:
        """A plain dictionary, ready for model.json."""
        tool = self.tool
        return {
            "format": FORMAT,
            "tool": {
                "kind": tool.kind,
                "teeth": tool.teeth,
                "diameter_m": _plain(tool.diameter_m),
                "helix_rad": _plain(tool.helix_rad),
            },
            "material": {name: _plain(getattr(self.material, name)) for name in _MATERIAL_FIELDS},
            "effects": [
                {"name": effect.name, "parameters": {k: _plain(v) for k, v in effect.values().items()}}
                for effect in self.effects
            ],
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ForceModel:
        """The model that `to_dict` described.

        Raises:
            ValueError: another format, an unknown effect, or a parameter missing or unknown.
        """
        if data.get("format") != FORMAT:
            raise ValueError(
                f"model format is {data.get('format')!r}; expected {FORMAT!r}, as ForceModel.to_dict() writes"
            )
        try:
            tool = Tool(**data["tool"])
            material = Material(**data["material"])
        except (KeyError, TypeError) as error:
            raise ValueError(
                f"model.json: tool or material is incomplete or has unknown keys ({error})"
            ) from error
        return cls(tool, material, tuple(_effect(entry) for entry in data.get("effects", ())))


_MATERIAL_FIELDS = ("K_tc_n_m2", "K_te_n_m", "K_rc_n_m2", "K_re_n_m", "K_ac_n_m2", "K_ae_n_m")


def _effect(entry: Mapping[str, Any]) -> AbstractEffect:
    kind = effect_class(str(entry.get("name")))
    given = dict(entry.get("parameters", {}))
    # what a later version added has a default, so that older files still load
    optional = {each.name for each in dataclasses.fields(kind) if each.default is not dataclasses.MISSING}
    if not set(kind.parameters) - optional <= set(given) <= set(kind.parameters):
        raise ValueError(
            f"effect {kind.name}: parameters are {sorted(given)}; "
            f"expected {sorted(kind.parameters)} in SI units"
        )
    return kind(
        **{name: jnp.asarray(value) if isinstance(value, list) else value for name, value in given.items()}
    )


def _plain(value: ArrayLike) -> Any:
    array = np.asarray(value, dtype=float)
    return float(array) if array.ndim == 0 else array.tolist()
