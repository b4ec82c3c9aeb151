"""What a headline of the paper is, and how it is judged.

A judgement is a rule written down before the results are looked at; it uses the summaries of
`evaluation.evaluate` and the training curves, and nothing else. "Not comparable" is for figures that depend
on what the paper does not publish (its reward's weights, its disturbance, its sheets), and for what a run
did not train or did not train for long enough.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

REPRODUCED, NOT, NOT_COMPARABLE = "reproduced", "not reproduced", "not comparable"
MOVING = "surrogate_dynamics"
"""The surrogate whose disturbance also acts on dynamics and reward."""
Results = Mapping[str, Any]
Judged = tuple[str, dict[str, float]]


@dataclass(frozen=True)
class Headline:
    """One result of the paper.

    Arguments:
        name: key in the results file.
        paper: what the paper reports.
        judge: results by domain (and "curves") -> (judgement, our figures).
        measured: where the paper measured it: "simulation" or "robot".
    """

    name: str
    paper: str
    judge: Callable[[Results], Judged]
    measured: str = "simulation"


def judged(headlines: Iterable[Headline], results: Results) -> dict[str, dict[str, Any]]:
    """Return, for every headline, its judgement, the paper's result and our figures.

    Where a run lacks what the rule needs (a strategy, a domain), the headline is not comparable.
    """
    told: dict[str, dict[str, Any]] = {}
    for headline in headlines:
        paper = {"paper": headline.paper, "measured": headline.measured}
        try:
            judgement, ours = headline.judge(results)
            told[headline.name] = {"judgement": judgement, **paper, "ours": ours}
        except KeyError as missing:
            lacks = f"this run has no {missing.args[0]}"
            told[headline.name] = {"judgement": NOT_COMPARABLE, **paper, "ours": {}, "missing": lacks}
    return told


def rule(fine: bool) -> str:
    """The judgement of a rule that holds or does not."""
    return REPRODUCED if fine else NOT
