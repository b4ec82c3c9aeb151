"""Measured against predicted force over one revolution of the tool, before and after.

The samples of a trial are folded by the angle of the tool. The median and the band of the middle 80 % of what
was measured show what repeats and what does not. A model that repeats is drawn as its lines; of one whose
force changes along the trial the median of its turns stands beside that of the measured ones. Shown are the
trials of the lowest, the middle and the highest feed per tooth.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mjx_cutting._report.style import (
    AFTER,
    BEFORE,
    FLOOR,
    MEASURED,
    SPREAD,
    legend_above,
    new_figure,
    style_axes,
)
from mjx_cutting.tracing.records.lines import basis
from mjx_cutting.tracing.report.figures.subject import (
    AXES,
    BASE_LABEL,
    Array,
    Subject,
    after_label,
    force_unit,
    named,
    spread_over,
    subjects,
)
from mjx_cutting.tracing.told import Tracing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN = 3
_SAMPLES_A_BIN = 6
_FEWEST_BINS = 24
_MOST_BINS = 240
_CURVE_POINTS = 1441
_CURVE_SAMPLES = 4000
_TOLD_APART = 3e-3
_REPEATS = 0.1
_ROUNDING = 1e-12


def revolution_figure(tracing: Tracing) -> Figure:
    """Returns the figure: an axis of force a row, a trial a column."""
    chosen = shown(tracing)
    rows = min(len(AXES), chosen[0].before.measured_n.shape[1])
    figure = new_figure(0.9 + 1.75 * rows)
    grid = figure.subplots(rows, len(chosen), sharex=True, squeeze=False)
    ranks = ["lowest feed: ", "middle feed: ", "highest feed: "]
    differ = len({each.feed_per_tooth_m for each in chosen}) == len(ranks)
    for column, subject in enumerate(chosen):
        _draw(list(grid[:, column]), tracing, subject)
        for row in range(rows):
            axes = grid[row, column]
            style_axes(
                axes,
                title=(ranks[column] * differ + subject.label) if row == 0 else "",
                x="tool angle (°)" if row == rows - 1 else "",
                y=f"{AXES[row]}, {force_unit(tracing)}" if column == 0 else "",
            )
            axes.set_xlim(0.0, 360.0)
            axes.set_xticks(np.arange(0, 361, 90))
    handles, labels = grid[0, 0].get_legend_handles_labels()
    legend_above(figure, handles, labels)
    return figure


def shown(tracing: Tracing) -> list[Subject]:
    """Returns the trials of the lowest, the middle and the highest feed per tooth."""
    ordered = sorted(subjects(tracing), key=lambda each: (each.feed_per_tooth_m, each.number))
    return [ordered[index] for index in spread_over(len(ordered), _SHOWN)]


def folded(angle_rad: Array, force: Array) -> tuple[Array, Array]:
    """Folds a record [T] over one turn.

    Returns: centres of the bins that hold samples, in degrees [B]; the 10, 50 and 90 % quantiles [B, 3].
    """
    count = int(np.clip(len(angle_rad) // _SAMPLES_A_BIN, _FEWEST_BINS, _MOST_BINS))
    bins = np.minimum((np.mod(angle_rad, 2 * np.pi) / (2 * np.pi) * count).astype(int), count - 1)
    order = np.argsort(bins, kind="stable")
    present, starts = np.unique(bins[order], return_index=True)
    parts = np.split(force[order], starts[1:])
    levels = np.array([np.quantile(part, [0.1, 0.5, 0.9]) for part in parts])
    return (present + 0.5) * 360.0 / count, levels


def repeated(angle_rad: Array, force: Array, orders: int) -> tuple[Array, Array]:
    """Draws the lines of a model's record [T, A] over one turn, finer than it was sampled.

    Where the samples fall on too few angles to tell the orders apart, or turn differs from turn by a tenth of
    what changes in them, their medians are joined instead.
    Returns: tool angle in degrees [P] and force [P, A].
    """
    step = max(1, len(angle_rad) // _CURVE_SAMPLES)
    columns, samples = basis(angle_rad[::step], orders), force[::step]
    weights = _lines(columns, samples)
    if weights is None or not _repeats(samples, samples - columns @ weights):
        degrees, _ = folded(angle_rad, force[:, 0])
        return degrees, np.stack([folded(angle_rad, axis)[1][:, 1] for axis in force.T], axis=-1)
    finely = np.linspace(0.0, 360.0, _CURVE_POINTS)
    return finely, basis(np.radians(finely), orders) @ weights


def _lines(columns: Array, samples: Array) -> Array | None:
    """Weights of the lines in samples [T, A]; None where the angles do not tell them apart."""
    gram = columns.T @ columns
    spread = np.linalg.eigvalsh(gram)
    return np.linalg.solve(gram, columns.T @ samples) if spread[0] >= _TOLD_APART * spread[-1] else None


def _repeats(samples: Array, rest: Array) -> bool:
    """Whether what the lines leave is little beside what changes, or no more than rounding."""
    changing = samples - samples.mean(axis=0)
    most = _REPEATS**2 * np.sum(changing**2) + _ROUNDING * np.sum(samples**2)
    return bool(np.sum(rest**2) <= most)


def _draw(column: Sequence[Axes], tracing: Tracing, subject: Subject) -> None:
    """Draws one trial, an axis of force in each of the axes."""
    angle, orders = subject.after.angle_rad, tracing.lines.orders
    before = repeated(angle, subject.before.predicted_n, orders)
    after = repeated(angle, subject.after.predicted_n, orders)
    for row, axes in enumerate(column):
        degrees, levels = folded(angle, subject.before.measured_n[:, row])
        band: dict[str, Any] = {"color": SPREAD, "linewidth": 0, "label": "measured, middle 80 % of turns"}
        axes.fill_between(degrees, levels[:, 0], levels[:, 2], **band)
        axes.plot(degrees, levels[:, 1], color=MEASURED, linewidth=1.3, label="measured, median")
        dashes = (0, (4, 2))
        axes.plot(
            before[0], before[1][:, row], color=BEFORE, linewidth=1.5, linestyle=dashes, label=BASE_LABEL
        )
        if named(tracing):
            axes.plot(after[0], after[1][:, row], color=AFTER, linewidth=1.7, label=after_label(tracing))
        low, high = axes.get_ylim()
        if low < 0.0 < high:
            axes.axhline(0.0, color=FLOOR, linewidth=0.6)
