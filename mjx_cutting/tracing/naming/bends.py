"""The bend of the force over the feed, as few unknowns tell it.

Of a tool that gives one level a trial, the trials show how the force bends over their few feeds, axis by
axis, and no more. A law with an unknown for each axis follows any such bend; where one with fewer unknowns
follows it as well, that would be a coincidence if it were not the cause. So among laws of the chip alone
(edge stage, no covariate) the one with the fewest is named, and one with more is no second explanation.
"""

from __future__ import annotations

from collections.abc import Sequence

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.fitting.fit import Effects
from mjx_cutting.tracing.naming.candidate import Candidate, Contest, beyond_chance
from mjx_cutting.tracing.naming.chance import CHANCE
from mjx_cutting.tracing.records.levels import LEVEL_KINDS


def fewest(contest: Contest, effects: Effects, best: Candidate, tried: Sequence[Candidate]) -> Candidate:
    """The accepted candidate `best`, or one of those `tried` beside `effects` that passed as well, needs
    fewer unknowns and is not behind it by more than chance."""
    tool = contest.problem.tool
    if tool.kind not in LEVEL_KINDS or not of_chip(best.kind):
        return best

    def unknowns(each: Candidate) -> tuple[int, int]:
        return each.told, each.kind.size(tool)

    passed = (each for each in tried if each.decision.accepted and of_chip(each.kind))
    for other in sorted(passed, key=unknowns):
        if unknowns(other) >= unknowns(best):
            break
        known, more = (*effects, other.kind), (*effects, best.kind)
        if beyond_chance(contest.problem, contest.lines, known, other.fit, more, best.fit, 1) > CHANCE:
            return other
    return best


def follows_any(tool_kind: str, named: Candidate, other: Candidate) -> bool:
    """Whether `other` needs more unknowns than the law `named` for the same bend."""
    laws = of_chip(named.kind) and of_chip(other.kind)
    return tool_kind in LEVEL_KINDS and laws and other.told > named.told


def of_chip(kind: type[AbstractEffect]) -> bool:
    """Whether an effect is a law of the chip alone."""
    return kind.stage == "edge" and kind.steady and not kind.needs
