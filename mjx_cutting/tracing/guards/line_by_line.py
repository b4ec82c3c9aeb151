"""Is a response at a fixed frequency more than a gain that each line could have of its own?

A sensor's or a machine's response belongs to frequencies, what the teeth do to orders of the spindle. Trials
at several speeds move the orders over the frequencies. Where all turn at one speed, any effect that makes
some lines larger and others smaller passes for a response, which has the same few lines to fit. So there it
is held against an unnamed gain and lag of every line: a response that is the cause explains nearly as much.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from mjx_cutting import _platform
from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import Effects
from mjx_cutting.tracing.fitting.model_lines import model_lines
from mjx_cutting.tracing.fitting.problem import Problem, model_at, shared_bias
from mjx_cutting.tracing.fitting.residual import marks, residual_of_lines
from mjx_cutting.tracing.guards.gain import Gain

_SPEEDS_APART = 1.05
_SHARE_OF_FREE = 0.9
_MOST_LINES = 64
Array = NDArray[np.floating]


def rather_by_line(gain: Gain) -> str | None:
    """Why a response is refused where gains of the lines do better; None where they do not, or it is none."""
    problem = gain.problem
    speed = np.asarray(problem.cut.spindle_speed_rev_s)
    if not _responds(gain.kind) or speed.max() > _SPEEDS_APART * speed.min():
        return None
    left, columns = (np.asarray(each) for each in _gains(problem, gain.others, gain.before.x))
    after = Descent(problem, gain.effects)
    rest = after.rows(np.asarray(gain.found.x)[None]).left[0, : after.measured]
    plain, explained = float(np.sum(left**2)), float(np.sum(left**2) - np.sum(rest**2))
    strongest = np.argsort(-np.sum(columns**2, axis=(0, 2)))[:_MOST_LINES]
    by_line = np.concatenate(columns[:, strongest]).T
    fitted = np.linalg.lstsq(by_line, left, rcond=None)[0]
    unnamed = plain - float(np.sum((left - by_line @ fitted) ** 2))
    if explained >= _SHARE_OF_FREE * unnamed:
        return None
    return (
        f"a gain of its own for each multiple of the spindle explains {unnamed / max(explained, 1e-300):.1f} "
        "times as much, and at one speed a frequency is not told from a multiple: cut at another"
    )


def _responds(kind: type[AbstractEffect]) -> bool:
    """Whether an effect acts by frequency, the same all along the path."""
    return kind.transfer is not AbstractEffect.transfer and not kind.by_position


@partial(_platform.jit_for_few_calls, static_argnums=1)
def _gains(problem: Problem, effects: Effects, x: jax.Array) -> tuple[jax.Array, jax.Array]:
    """[M] weighted residual, and [2, orders, M] what a gain and a lag of each line would add to the model."""
    lines = model_lines(problem, model_at(problem, x, effects))
    left = residual_of_lines(problem, lines, shared_bias(problem, x))

    def of_one(order: jax.Array, factor: jax.Array) -> jax.Array:
        here = jnp.arange(lines.shape[1])[None, :, None] == order
        return marks(problem, jnp.where(here, factor * lines, 0.0), left.phase_rad).ravel()

    orders = jnp.arange(1, lines.shape[1])
    factors = jnp.array([1.0 + 0.0j, 1.0j])
    by_order = jax.vmap(jax.vmap(of_one, in_axes=(0, None)), in_axes=(None, 0))(orders, factors)
    return left.weighted.ravel(), by_order
