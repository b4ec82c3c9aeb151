"""Is one more effect there, or are those before it only not quite as their laws have them?

Every law is an idealisation: a filter is no exact Butterworth, runout not one circle, a helix not exactly
what was ground. What an effect found does to the force is calculated right to some per cent of itself, and
the library holds something that resembles the rest. So a further effect must account for more than that: over
all lines, and on the lines it works on of what the others do there. A smaller one is named all the same if
next to nothing is left beside it: what resembles an error of a law leaves much of it.
"""

from __future__ import annotations

import numpy as np

from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.on_lines import its_lines, noise_squares, squares
from mjx_cutting.tracing.guards.gain import Gain
from mjx_cutting.tracing.records.levels import LEVEL_KINDS

_OF_ALL = 0.05
_OF_ITS_LINES = 0.1
_NEXT_TO_NOTHING = 0.2
_STEPS = 6


def rather_their_law(gain: Gain) -> str | None:
    """Why a further effect is refused that does no more than the laws of those before it may be off; None
    where it is not, or is the first."""
    problem, before = gain.problem, gain.others
    if not before or problem.tool.kind in LEVEL_KINDS:
        return None
    old = squares(problem, before, gain.before.x)
    new = squares(problem, gain.effects, gain.found.x)
    quiet = noise_squares(problem, gain.lines)
    if (new - quiet).sum() <= _NEXT_TO_NOTHING * (old - quiet).sum():
        return None
    base = np.asarray(gain.before.x)[: -sum(kind.size(problem.tool) for kind in before)]
    base, _ = Descent(problem, ()).descend(base, _STEPS)
    none = squares(problem, (), base)
    its = its_lines(problem, old, new)
    for share, where in ((_OF_ALL, np.ones_like(its)), (_OF_ITS_LINES, its)):
        accounted, gained = (
            float(np.sqrt(max((more - less)[:, where].sum(), 0.0)))
            for more, less in ((none, old), (old, new))
        )
        if gained < share * accounted:
            what = "all that they do" if where.all() else "what they do on its lines"
            names = " and ".join(kind.name for kind in before)
            return (
                f"accounts for {gained / accounted:.1%} of {what}; the laws of {names} are not known better "
                f"than to {share:.0%}"
            )
    return None
