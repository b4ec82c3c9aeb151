"""How far a model's own error may carry its parameters.

Statistics of the trials tell how far noise moves a fitted parameter; with long records that is next to
nothing. But no two calculations of a cutting force agree better than `TOLERANCE` of it, and an error of that
size may point along a parameter's own mark. With J the Jacobian of the weighted residual, C = (J^T J)^-1 and
|F| the weighted size of the force, it then moves a quantity g(x) by at most

    TOLERANCE |F| sqrt(grad g^T C grad g).
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjx_cutting.tracing.decision import TOLERANCE
from mjx_cutting.tracing.descent import Descent
from mjx_cutting.tracing.fit import Effects
from mjx_cutting.tracing.lines import Lines
from mjx_cutting.tracing.problem import Problem, model_at

_STEP = 1e-4
Array = NDArray[np.floating]


def tolerated(problem: Problem, lines: Lines) -> float:
    """Weighted size of the tolerated model error over all lines."""
    return TOLERANCE * float(np.sqrt(np.sum(lines.energy_n2 * np.asarray(problem.weight) ** 2)))


def model_errors(problem: Problem, lines: Lines, effects: Effects, x: ArrayLike) -> list[dict[str, Array]]:
    """How far the tolerated model error moves every parameter ([] or [N]) of every effect, by name.

    Arguments: problem, lines; the effects; `x` [U] the unknowns fitted (call it in float64).
    """
    here = np.asarray(x)
    descent = Descent(problem, effects)
    slope = descent.slope(here, descent.rows(here[None]).left[0])[: descent.measured]
    spread = np.linalg.pinv(slope.T @ slope, hermitian=True)
    beside = jnp.asarray(np.concatenate([here[None], here + _STEP * np.eye(len(here))]))
    values = jax.vmap(lambda each: model_at(problem, each, effects).effects)(beside)
    found = []
    for kind, effect in zip(effects, values, strict=True):
        errors = {}
        for name in kind.parameters:
            value = np.broadcast_to(
                getattr(effect, name), (len(beside), *np.shape(getattr(effect, name))[1:])
            )
            gradient = np.moveaxis(value[1:] - value[0], 0, -1) / _STEP
            moved = np.einsum("...i,ij,...j->...", gradient, spread, gradient)
            errors[name] = tolerated(problem, lines) * np.sqrt(np.maximum(moved, 0.0))
        found.append(errors)
    return found
