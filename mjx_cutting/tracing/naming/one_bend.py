"""Few feeds show that the force bends, not where: ploughing is then one explanation, never the finding.

Of a drill or a turning tool each trial gives a level at one chip thickness. Base law and bend take three
thicknesses to fix; where ploughing ends and how much stiffer it is are two numbers for that one bend, and
with a stiffness for each direction any three levels are followed exactly, be they scatter. A fourth thickness
is the first to contradict it.
"""

from __future__ import annotations

import numpy as np

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.cutting.effects.ploughing import Ploughing
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.records.levels import LEVEL_KINDS

_FEWEST = 4
_ANOTHER = 0.05


def one_bend(problem: Problem, kind: type[AbstractEffect]) -> str | None:
    """Why the trials cannot show `kind` for what it is; None where they can."""
    if problem.tool.kind not in LEVEL_KINDS or not issubclass(kind, Ploughing):
        return None
    feed = np.asarray(problem.cut.feed_speed_m_s) / np.asarray(problem.cut.spindle_speed_rev_s)
    count = 1 + int(np.sum(np.diff(np.sort(np.log(feed))) > _ANOTHER))
    if count >= _FEWEST:
        return None
    return (
        f"{count} feeds show one bend of the force, and ploughing follows any; {_FEWEST} or more, at least "
        f"{_ANOTHER:.0%} apart, are asked: cut at others too"
    )
