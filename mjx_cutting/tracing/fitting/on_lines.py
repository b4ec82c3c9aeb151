"""What models leave of the lines of the force, and noise alone would; and which lines an effect works on."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import Effects
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.records.lines import Lines

_ITS_WORK = 0.5


def squares(problem: Problem, effects: Effects, x: ArrayLike) -> NDArray[np.floating]:
    """[R, P, 3] squared weighted residual of every line."""
    descent = Descent(problem, effects)
    left = descent.rows(np.asarray(x)[None]).left[0, : descent.measured]
    return np.asarray(left.reshape(problem.whitened.shape) ** 2)


def noise_squares(problem: Problem, lines: Lines) -> NDArray[np.floating]:
    """[R, P, 3] squared weighted size that the sensor's noise gives every line."""
    noise = (lines.noise_std_n() * np.asarray(problem.weights)) ** 2
    return np.asarray(noise[:, None] * np.asarray(problem.present)[..., None])


def its_lines(
    problem: Problem, before: NDArray[np.floating], after: NDArray[np.floating]
) -> NDArray[np.bool_]:
    """[P] the lines an effect works on, those at tooth passing or all others, by the `squares` before and
    after it."""
    once = problem.order % problem.tool.teeth != 0
    gained = before - after
    return once if float(gained[:, once].sum()) >= _ITS_WORK * float(gained.sum()) else ~once
