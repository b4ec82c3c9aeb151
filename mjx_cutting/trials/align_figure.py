"""The picture of an alignment: all trials over each other, before and after each step, one row a channel."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mjx_cutting import _files
from mjx_cutting.trials.align import Alignment
from mjx_cutting.trials.resampling import dominant_period

SHOWN_PERIODS = 12.0  # of the strongest line, so that single cycles are seen


def draw(
    alignment: Alignment, channels: Sequence[str] = ("x", "y", "z"), shown_s: float | None = None
) -> Figure:
    """Returns the figure: trials on their own clocks (left), shifted where a warp followed, and aligned
    (right), their mean in black, N over s.

    Args:
        alignment: from `align` or `align_trials`.
        channels: names of the channels, for the axes' labels.
        shown_s: how much of the record is drawn, s; default twelve periods of its strongest line.
    """
    time = alignment.time_s
    if shown_s is None:
        period = dominant_period(alignment.after, float(time[1] - time[0]))
        shown_s = SHOWN_PERIODS * period if np.isfinite(period) else float(time[-1] - time[0])
    count = alignment.after.shape[2]
    names = list(channels)[:count] if len(channels) >= count else [str(c) for c in range(count)]
    warped = any(match is not None for match in alignment.matches)
    columns = [("before, each on its own clock", alignment.before)]
    if warped:
        columns.append(("shifted", alignment.shifted))
    how = "shifted and warped in" if warped else "aligned in"
    columns.append((f"after, {how} {alignment.variable.replace('_', ' ')}", alignment.after))
    figure = Figure(figsize=(2 + 4 * len(columns), 1.2 + 2.1 * count), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(count, len(columns), sharex=True, sharey="row", squeeze=False)
    kept = time <= time[0] + shown_s
    for column, (title, values) in enumerate(columns):
        panels[0, column].set_title(title, fontsize=10)
        for c in range(count):
            panel = panels[c, column]
            for trial in values:
                panel.plot(time[kept], trial[kept, c], lw=0.6, alpha=0.6)
            seen = np.isfinite(values[:, kept, c]).any(0)
            mean = np.full(int(kept.sum()), np.nan)
            mean[seen] = np.nanmean(values[:, kept, c][:, seen], axis=0)
            panel.plot(time[kept], mean, color="black", lw=1.0, label=f"mean of {len(values)} trials")
            panel.grid(alpha=0.25)
            if column == 0:
                panel.set_ylabel(f"force {names[c]} (N)")
        panels[-1, column].set_xlabel("time (s)" if column == 0 else "time on the common clock (s)")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", fontsize=8, frameon=False)
    return figure


def save(alignment: Alignment, path: str | Path, channels: Sequence[str] = ("x", "y", "z")) -> Path:
    """Returns `path` (.png), now holding the figure; written whole or not at all."""
    buffer = io.BytesIO()
    draw(alignment, channels).savefig(buffer, format="png", dpi=110)
    return _files.write_atomic(path, buffer.getvalue())
