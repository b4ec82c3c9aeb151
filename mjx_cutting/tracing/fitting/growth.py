"""What an effect that grows with the length cut does within each held-out trial, which no line holds.

A trial's lines are its means over the path. In a long trial the edge wears while it is cut: what that leaves
between the lines the effect explains as well, and is judged by.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from mjx_cutting import _platform
from mjx_cutting.cutting import ForceModel
from mjx_cutting.tracing.fitting.fit import Fit
from mjx_cutting.tracing.fitting.moving import MovingLines, wave
from mjx_cutting.tracing.fitting.prediction import FEW_KNOTS, along_the_path
from mjx_cutting.tracing.fitting.problem import Problem, shared_bias
from mjx_cutting.tracing.fitting.residual import residual_of_lines
from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.tracing.records.lines import Lines, band_limit
from mjx_cutting.tracing.records.spindle import spindle_angle


def growth_n2(problem: Problem, lines: Lines, fits: Fit, own: NDArray[np.int64]) -> NDArray[np.float64]:
    """[R, 3] change of the squared error of every trial, N^2, where what grows does so within the trial.

    Arguments: `fits` of every fold [F]; `own` [R] fold whose model a trial is held against.
    """
    bias = jax.vmap(partial(shared_bias, problem))(jnp.asarray(fits.x))
    places, phase, bias_n = map(np.asarray, _along(problem, fits.model, bias, jnp.asarray(own)))
    rate_hz = lines.dataset.sensor.sample_rate_hz
    trials = [trial for trial in lines.dataset.trials if trial.kind == "cut"]
    change = np.zeros((len(trials), 3))
    for index, trial in enumerate(trials):
        if not np.all(np.isfinite(places[index])):
            # what cannot be computed all along the path explains nothing there
            continue
        angle = spindle_angle(trial, float(lines.speed_rev_s[index])) + phase[index]
        left = band_limit(trial.force_n, rate_hz, lines.band_hz) - bias_n[index]
        still = left - wave(lines, index, angle, places[index].mean(axis=0), rate_hz)
        grown = left - MovingLines(lines, index, places[index], along_path(trial), rate_hz).force(angle)
        change[index] = np.sum(grown**2, axis=0) - np.sum(still**2, axis=0)
    return change


@_platform.jit_for_few_calls
def _along(problem: Problem, models: ForceModel, bias_n: Array, own: Array) -> tuple[Array, Array, Array]:
    """[R, K, orders + 1, 3] lines along every trial, [R] its phase, [R, 3] its bias, by its fold's model."""

    def one(each: tuple[ForceModel, Array]) -> tuple[Array, Array, Array]:
        places = along_the_path(problem, each[0], FEW_KNOTS)
        left = residual_of_lines(problem, jnp.mean(places, axis=1), each[1])
        return places, left.phase_rad, left.bias_n

    trial = jnp.arange(problem.trials)
    places, phase, bias = jax.lax.map(one, (jax.tree.map(jnp.asarray, models), bias_n))
    return places[own, trial], phase[own, trial], bias[own, trial]
