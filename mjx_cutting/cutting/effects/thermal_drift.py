"""Thermal drift: the sensor's zero creeps as it warms up.

b (exp(-t_0 / tau) - exp(-t / tau)) since zeroing at t_0; with the amplitude counted from the zeroing it is

    drift (1 - exp(-(t - t_0) / tau)),   t - t_0 = Cut.clock_s

one amplitude an axis. Signature: slow, by the CLOCK, in air too; invisible where each trial was zeroed.
Confused with wear, which goes with the length cut: let the tool idle, then repeat the first trial.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects.abstract import AbstractEffect, Parameter
from mjx_cutting.cutting.effects.registry import register

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel


@register
class ThermalDrift(AbstractEffect):
    """Exponential creep of the zero.

    Fields: `drift_n` [3] final drift of each axis since zeroing, N; `tau_s` [] time constant, s.
    """

    name = "thermal_drift"
    stage = "sensor"
    strength = "drift_n"
    parameters = {
        "drift_n": Parameter("N", -500.0, 500.0, 0.0, 2.0, length=3, source="working knowledge"),
        "tau_s": Parameter("s", 30.0, 2e4, None, 1200.0, log=True, source="5-60 min"),
    }
    needs = ("clock",)
    signature = "slow, by the clock, in air too"
    confused_with = {"flank_wear": "wear grows with the length cut: idle, then repeat the first trial"}

    drift_n: ArrayLike
    tau_s: ArrayLike

    def sense(self, force: Array, cut: Cut, model: ForceModel) -> Array:
        warmed = -jnp.expm1(-jnp.asarray(cut.clock_s) / self.tau_s)
        return force + warmed[..., None] * jnp.asarray(self.drift_n)
