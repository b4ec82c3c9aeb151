"""Waves of chip and edge of teeth that each meet a pattern of the sheet where they are.

A tooth at the angle th is x = R sin th ahead of the tool's centre. With each tooth's share of the lines
turned by exp(i k x), the force on a sheet that goes with cos(k s + phase) is Re(wave exp(i (k s + phase))),
s the place of the centre.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, lru_cache

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect, Cut, ForceModel
from mjx_cutting.cutting.chip import Chip
from mjx_cutting.cutting.effects.abstract import EdgeForce
from mjx_cutting.tracing.fitting.moving import wave
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.records.lines import Lines

SHORTEST_M = 2e-3
"""The shortest wavelength whose lines are calculated as exactly as those of an even sheet."""
_KEPT = 64
_ANGLES = 512
Complex = NDArray[np.complexfloating]
Array = NDArray[np.floating]


class _Pattern(AbstractEffect):
    """The force of every tooth times 1 + cos(k (x - middle) - late), x how far it is ahead."""

    stage = "edge"

    wave_rad_m: ArrayLike
    middle_m: ArrayLike
    late_rad: ArrayLike

    def edge(self, force: EdgeForce, chip: Chip, cut: Cut, model: ForceModel) -> EdgeForce:
        ahead_m = 0.5 * model.tool.diameter_m * jnp.sin(chip.angle_rad) - self.middle_m
        more = jnp.cos(self.wave_rad_m * ahead_m - self.late_rad)[..., None]
        return EdgeForce(force.chip * (1.0 + more), force.edge * (1.0 + more))


class AtTeeth:
    """Lines and waves of one steady model on patterns of any wave number.

    Fields: `ahead_m` how far a tooth in the cut is ahead of the tool's centre at least and at most, m.
    """

    def __init__(
        self,
        problem: Problem,
        model: ForceModel,
        split: Callable[[Problem, ForceModel], tuple[Complex, Complex]],
    ):
        """`split` gives the lines [R, orders + 1, 3] of chip and edge of a model."""
        entry, exit_ = (np.asarray(each)[:, None] for each in (problem.cut.entry_rad, problem.cut.exit_rad))
        ahead = (
            0.5 * problem.tool.diameter_m * np.sin(entry + (exit_ - entry) * np.linspace(0.0, 1.0, _ANGLES))
        )
        self.ahead_m = (float(ahead.min()), float(ahead.max()))
        # a pattern turns within the arc as lines of higher orders do
        turn_rad = 2.0 * np.pi / SHORTEST_M * (self.ahead_m[1] - self.ahead_m[0])
        finer = replace(problem, arc_rad=problem.arc_rad + turn_rad / max(problem.orders, 1))
        middle_m = 0.5 * sum(self.ahead_m)

        @cache
        def even() -> Complex:
            return np.stack(split(finer, model))

        @lru_cache(maxsize=_KEPT)
        def lines(wave_rad_m: float) -> Complex:
            patterns = (_Pattern(wave_rad_m, middle_m, late) for late in (0.0, 0.5 * np.pi))
            return np.stack([split(finer, model.with_effects(each)) - even() for each in patterns])

        self.lines = lines
        """[2, 2, R, orders + 1, 3] of a wave number, rad/m: with cosine and sine, of chip and edge."""

    def waves(
        self, lines: Lines, trial: int, angle_rad: Array, rate_hz: float, waves: Sequence[float]
    ) -> Complex:
        """[K, 2, T, 3] complex waves of chip and edge at the tool angles [T] of a trial, of wave numbers [K],
        rad/m, within the band, N."""
        own = np.stack([self.lines(each)[:, :, trial] for each in waves])  # [K, 2, 2, orders + 1, 3]
        columns = np.moveaxis(own, 3, 0)
        found = wave(lines, trial, angle_rad, columns.reshape(len(columns), -1), rate_hz)
        cosine, sine = np.moveaxis(found.reshape(-1, *columns.shape[1:]), [2, 0], [0, 3])
        return np.asarray(cosine + 1j * sine)
