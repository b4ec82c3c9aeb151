"""Is a named effect the cause of what the lines lack, or just a little like it?

Whatever makes teeth unlike each other (a dull sector, a mixed set of inserts) leaves lines at all multiples
of the spindle, and every effect that does the same takes its share of them; so does, at tooth passing, every
effect that bends the force under a tooth, whatever bends it. The true one takes most; of two that are there
together the larger takes a good part, and the other most of the rest. One that takes little of the lines it
works on, and leaves more there than a model may be off, is not the cause; nor one that gives back at tooth
passing what it takes once a turn, or takes its part there.
"""

from __future__ import annotations

from mjx_cutting.tracing.fitting.model_error import tolerated
from mjx_cutting.tracing.fitting.on_lines import its_lines, noise_squares, squares
from mjx_cutting.tracing.guards.gain import Gain
from mjx_cutting.tracing.records.levels import LEVEL_KINDS

_LEAST_PART = 0.5
_LEAST_AT_TOOTH_PASSING = 0.4
_LEAST_OF_THE_REST = 0.7


def rather_unlike(gain: Gain) -> str | None:
    """Why an effect is refused that explains little of the lines it works on; None where it is not."""
    problem, lines = gain.problem, gain.lines
    if problem.tool.kind in LEVEL_KINDS:
        return None
    old = squares(problem, gain.others, gain.before.x)
    new = squares(problem, gain.effects, gain.found.x)
    quiet = noise_squares(problem, lines)
    its = its_lines(problem, old, new)
    unlike = not its[0]
    everywhere, there_alone = float((old - new).sum()), float((old - new)[:, its].sum())
    gained = min(everywhere, there_alone) if unlike else everywhere
    there, left = (float((each - quiet)[:, its].sum()) for each in (old, new))
    if not unlike and left <= tolerated(problem, lines) ** 2:
        return None
    at_passing = _LEAST_OF_THE_REST if gain.others else _LEAST_AT_TOOTH_PASSING
    if gained >= (_LEAST_PART if unlike else at_passing) * there:
        return None
    if unlike:
        return f"explains {gained / there:.0%} of what repeats once a turn: the teeth differ in another way"
    return f"explains {gained / there:.0%} of what repeats at tooth passing and leaves the rest"
