"""Parameters of the model with their 95 % intervals, as shares of their estimates.

An interval that reaches 0 cannot tell the parameter from nothing. The small marks are the fits with one part
of the trials left out, of which the intervals are made (delete-group jackknife).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mjx_cutting._report.style import AFTER, FLOOR, MEASURED, new_figure, plain, style_axes
from mjx_cutting.tracing.report.parameters import Estimate, estimates
from mjx_cutting.tracing.told import Tracing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LOW, _HIGH = -0.6, 2.6


def intervals_figure(tracing: Tracing) -> Figure | None:
    """Returns the figure: a parameter a row; None where no parameter has a value other than zero."""
    shown = [each for each in estimates(tracing) if _sized(each)]
    if not shown:
        return None
    figure = new_figure(1.0 + 0.34 * len(shown))
    axes = figure.subplots()
    for row, each in enumerate(shown):
        _draw(axes, row, each)
    axes.axvline(1.0, color=FLOOR, linewidth=0.8)
    axes.axvline(0.0, color=MEASURED, linewidth=1.0, linestyle=(0, (2, 2)))
    style_axes(axes, x="share of the estimate (1 = the estimate, 0 = nothing)", grid="x")
    axes.set_xlim(_LOW, _HIGH)
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.set_yticks(range(len(shown)), [plain(f"{each.label}   {each.text}", 60) for each in shown])
    axes.tick_params(axis="y", length=0)
    return figure


def _sized(each: Estimate) -> bool:
    """Whether a share of the estimate says something: not for a direction, nor for what was held."""
    return each.value != 0.0 and not (each.held or each.whole) and (each.strength or each.unit != "rad")


def _draw(axes: Axes, row: int, each: Estimate) -> None:
    colour = AFTER if each.effect else MEASURED
    share = np.sort(np.array([each.low, each.high]) / each.value)
    low, high = np.clip(share, _LOW, _HIGH)
    axes.hlines(row, low, high, color=colour, linewidth=3.2, alpha=0.45)
    for end, limit, marker in ((share[0], _LOW, "<"), (share[1], _HIGH, ">")):
        if (end < limit) if marker == "<" else (end > limit):
            axes.scatter([limit], [row], marker=marker, s=40, color=colour, clip_on=False)
    folds = np.clip(np.asarray(each.by_fold) / each.value, _LOW, _HIGH)
    axes.scatter(folds, np.full(len(folds), row), marker="|", s=60, color=colour, linewidths=1.0)
    axes.scatter([1.0], [row], marker="o", s=44, color=colour, zorder=3)
