"""How far a model's own error may carry its parameters.

Statistics of the trials tell how far noise moves a fitted parameter; with long records that is next to
nothing. But no two calculations of a cutting force agree better than some `tolerance` of it, and an error of
that size may point along a parameter's own mark. With J the Jacobian of the weighted residual, C = (J^T
J)^-1 and |F| the weighted size of the force, it then moves a quantity g(x) by at most

    tolerance |F| sqrt(grad g^T C grad g).

How strong an effect is may trade off against its shape (how stiff ploughing is below which thickness) until
either is next to unknown; whether it is there at all is another question, because at no strength the shape
means nothing. For that the same is told with the effect's shape held.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigh, null_space, pinvh

from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import Effects
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.records.lines import Lines

_STEP = 1e-4
Array = NDArray[np.floating]


def tolerated(problem: Problem, lines: Lines) -> float:
    """Weighted size of the tolerated model error over all lines."""
    return problem.tolerance * float(np.sqrt(np.sum(lines.energy_n2 * np.asarray(problem.weights) ** 2)))


@dataclass(frozen=True, eq=False)
class Moved:
    """What the tolerated error does to parameters.

    Fields:
        by_name: how far it moves each, [] or [N].
        scale: [N, N] (N = 1 for a number) turns the strength into multiples of that error with the effect's
            shape held: |scale s| of them undo a strength s, everything else being fitted again.
    """

    by_name: dict[str, Array]
    scale: Array


def model_errors(problem: Problem, lines: Lines, effects: Effects, x: ArrayLike) -> list[Moved]:
    """How far the tolerated model error moves the parameters of every effect.

    Arguments: problem, lines; the effects; `x` [U] the unknowns fitted (call it in float64).
    """
    here = np.asarray(x)
    descent = Descent(problem, effects)
    slope = descent.around(here)[1][: descent.measured]
    normal = slope.T @ slope
    beside = np.concatenate([here[None], here + _STEP * np.eye(len(here))])
    values = descent.models(beside).effects
    error = tolerated(problem, lines)
    found = []
    for kind, effect in zip(effects, values, strict=False):
        gradients = {}
        for name in kind.parameters:
            value = np.broadcast_to(
                getattr(effect, name), (len(beside), *np.shape(getattr(effect, name))[1:])
            )
            gradients[name] = np.moveaxis(value[1:] - value[0], 0, -1) / _STEP
        shape = [
            np.atleast_2d(gradients[name]) for name, each in kind.parameters.items() if each.identity is None
        ]
        held = null_space(np.concatenate(shape)) if shape else np.eye(len(here))
        by_name = {name: error * _reach(each, normal) for name, each in gradients.items()}
        spread = _spread(np.atleast_2d(gradients[kind.strength]), normal, held)
        found.append(Moved(by_name, _inverse_root(spread) / error))
    return found


def _reach(gradient: Array, normal: Array) -> Array:
    """[...] sqrt(g^T C g) of quantities with `gradient` [..., U]."""
    spread = pinvh(normal)
    return np.sqrt(np.maximum(np.einsum("...i,ij,...j->...", gradient, spread, gradient), 0.0))


def _spread(gradient: Array, normal: Array, ways: Array) -> Array:
    """[N, N] G C G^T of N quantities with `gradient` [N, U], moved along the columns of `ways` [U, K]."""
    along = gradient @ ways
    return np.asarray(along @ pinvh(ways.T @ normal @ ways) @ along.T)


def _inverse_root(square: Array) -> Array:
    """[N, N] A^-1/2 of a symmetric positive semidefinite matrix; zero along directions that cannot move."""
    values, vectors = eigh(square)
    kept = values > 1e-12 * max(values[-1], 1e-300)
    return np.asarray((vectors[:, kept] / np.sqrt(values[kept])) @ vectors[:, kept].T)
