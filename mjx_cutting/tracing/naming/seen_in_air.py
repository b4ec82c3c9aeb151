"""Is an effect seen in air, where nothing is cut?

Cuts scatter, by how hard the material is here and how fast the spindle truly turned, and where few of them
show what an effect does, that scatter hides it. In air there is none of it: where a zero moves from record to
record as an effect of the sensor has it, the effect is there, whatever the cuts say.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from mjx_cutting.cutting import ForceModel
from mjx_cutting.tracing.fitting.fit import Fit
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.naming.chance import CHANCE, chance

_LEFT = 0.1


def seen_in_air(problem: Problem, before: Fit, after: Fit, added: int, tries: int) -> bool:
    """Whether the fit `after` of an effect with `added` unknowns leaves a tenth or less of how levels in air
    differ under that `before` it, beyond what the best of `tries` does by chance."""
    if problem.air is None:
        return False
    old, new = (_squares(problem, each.model) for each in (before, after))
    freedom = (len(problem.air.samples) - 1) * int(np.sum(problem.alive)) - added
    if freedom < 1 or new > _LEFT * old:
        return False
    spread = float(np.sqrt(new / freedom))
    return chance(old - new, added, spread, floor=0.0, freedom=freedom, tries=tries) < CHANCE


def _squares(problem: Problem, model: ForceModel) -> float:
    """Weighted sum of squares by which levels in air differ beyond what `model` says."""
    assert problem.air is not None
    sensed = jax.vmap(lambda cut: model.sense(jnp.zeros(3), cut))(problem.air.cut)
    left = np.asarray((problem.air.level_n - sensed) * problem.weight)
    return float(np.sum((left - left.mean(axis=0)) ** 2))
