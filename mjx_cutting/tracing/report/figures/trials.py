"""Held-out error of every trial, before and after, beside what sensor noise alone leaves.

Each error is relative to the trial's own force, so a light cut shows its noise more than a heavy one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mjx_cutting._report.style import AFTER, BEFORE, FLOOR, GRID, legend_above, new_figure, plain, style_axes
from mjx_cutting.tracing.report.figures.subject import Array, after_label, named, subjects
from mjx_cutting.tracing.told import Tracing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NAMED_ROWS = 40


def trials_figure(tracing: Tracing) -> Figure:
    """Returns the figure: a trial a row, its error before and after as two points."""
    found = subjects(tracing)
    old = 100.0 * tracing.search.base.per_trial
    new = 100.0 * tracing.final.per_trial
    floor = 100.0 * floors(tracing)
    count = len(found)
    rows = np.arange(count)
    figure = new_figure(1.25 + (0.3 * count if count <= _NAMED_ROWS else 0.12 * _NAMED_ROWS))
    axes = figure.subplots()
    size = 52 if count <= _NAMED_ROWS else 16
    if named(tracing):
        axes.hlines(rows, new, old, color=GRID, linewidth=3 if count <= _NAMED_ROWS else 1, zorder=1)
    handles = [
        axes.scatter(floor, rows, marker="|", s=2.2 * size, color=FLOOR, linewidths=2, zorder=2),
        axes.scatter(
            old,
            rows,
            marker="D",
            s=0.75 * size,
            facecolor="white",
            edgecolor=BEFORE,
            linewidths=1.6,
            zorder=3,
        ),
    ]
    labels = ["noise floor", "before: base model"]
    if named(tracing):
        handles.append(axes.scatter(new, rows, marker="o", s=size, color=AFTER, zorder=4))
        labels.append(after_label(tracing))
    style_axes(axes, x="held-out error, % of the trial's own force (RMS)", grid="x")
    axes.set_xlim(0.0, 1.06 * max(float(np.max(old)), float(np.max(new)), float(np.max(floor)), 1e-6))
    axes.set_ylim(count - 0.4, -0.6)
    if count <= _NAMED_ROWS:
        names = [f"{plain(each.trial.file, 30)}   trial {each.number}" for each in found]
        axes.set_yticks(rows, names)
        axes.tick_params(axis="y", length=0)
    else:
        axes.set_ylabel("trial number", fontsize=9, color="#3e4c59")
        ticks = np.unique(np.linspace(0, count - 1, 11).astype(int))
        axes.set_yticks(ticks, [str(tick + 1) for tick in ticks])
    legend_above(figure, handles, labels)
    return figure


def floors(tracing: Tracing) -> Array:
    """Returns what sensor noise alone leaves of each trial, relative to that trial's force [R]."""
    lines = tracing.lines
    energy = lines.energy_n2.sum(axis=1) / lines.samples
    whole = lines.energy_n2.sum() / lines.samples.sum()
    return float(tracing.verdict["noise_floor_nrmse"]) * np.sqrt(whole / np.maximum(energy, 1e-30))
