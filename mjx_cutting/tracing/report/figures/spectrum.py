"""Amplitude of the residual against spindle order, before and after.

Order = frequency / spindle frequency: what repeats once a revolution stands at 1, tooth passing at the number
of teeth. Each trial's residual is windowed (Hann) and transformed; amplitudes are root mean squares over the
trials, so that a line of A newtons in every trial reads A. The level between the lines is what no steady
force of the spindle explains.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mjx_cutting._report.quantities import number
from mjx_cutting._report.style import AFTER, BEFORE, FLOOR, MEASURED, legend_above, new_figure, style_axes
from mjx_cutting.tracing.records.comb import folded_hz
from mjx_cutting.tracing.report.figures.subject import (
    AXES,
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

_MOST_TRIALS = 24
_MOST_POINTS = 1500
_PADDING = 4
_NEAR_LINE = 0.15
_LABELLED = 4
_CROWDED = 0.1
_FOLDS_MARKED = 6


def spectrum_figure(tracing: Tracing) -> Figure:
    """Returns the figure: an axis of force a row."""
    whole = subjects(tracing)
    used = [whole[index] for index in spread_over(len(whole), _MOST_TRIALS)]
    rows = min(len(AXES), used[0].before.measured_n.shape[1])
    figure = new_figure(0.9 + 1.6 * rows)
    grid = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    order = order_grid(tracing, used)
    old = [_residual_amplitude(tracing, used, order, row, after=False) for row in range(rows)]
    new = [_residual_amplitude(tracing, used, order, row, after=True) for row in range(rows)]
    top = max(1e-9, *(float(each.max()) for each in old + new))
    for row, axes in enumerate(grid):
        axes.fill_between(order, 0.0, old[row], color=BEFORE, alpha=0.25, linewidth=0)
        axes.plot(
            order, old[row], color=BEFORE, linewidth=1.2, linestyle=(0, (4, 1.5)), label="before: base model"
        )
        if named(tracing):
            axes.plot(order, new[row], color=AFTER, linewidth=1.6, label=after_label(tracing))
        level = between_lines(order, new[row])
        axes.axhline(level, color=FLOOR, linewidth=1.0, linestyle=":", label="level between the lines")
        _label_lines(axes, order, old[row], new[row], level, force_unit(tracing), named(tracing))
        style_axes(
            axes,
            x="spindle order (frequency / spindle frequency)" if row == rows - 1 else "",
            y=f"{AXES[row]}, {force_unit(tracing)}",
        )
        _mark_tooth_passing(axes, tracing, used, order, row == 0)
        axes.set_xlim(order[0], order[-1])
        axes.set_ylim(0.0, 1.25 * max(float(old[row].max()), float(new[row].max()), 0.1 * top))
    handles, labels = grid[0].get_legend_handles_labels()
    legend_above(figure, handles, labels)
    return figure


def order_grid(tracing: Tracing, used: list[Subject]) -> Array:
    """Returns the orders shown: those that the band spans in the slowest and the fastest trial."""
    slowest = min(each.before.speed_rev_s for each in used)
    low, high = tracing.lines.band_hz
    fastest = max(each.before.speed_rev_s for each in used)
    return np.linspace(low / fastest, high / slowest, _MOST_POINTS)


def order_spectrum(force: Array, time_s: Array, speed_rev_s: float, order: Array) -> Array:
    """Returns the amplitude [len(order)] of a record [T] around each order, the largest within each step."""
    left = force - force.mean()
    window = np.hanning(len(left))
    length = _PADDING * int(2 ** np.ceil(np.log2(len(left))))
    amplitude = 2.0 * np.abs(np.fft.rfft(left * window, n=length)) / window.sum()
    interval = (time_s[-1] - time_s[0]) / (len(time_s) - 1)
    at = np.fft.rfftfreq(length, interval) / speed_rev_s
    between = np.interp(order, at, amplitude, right=0.0)
    step = order[1] - order[0]
    bins = np.round((at - order[0]) / step).astype(int)
    inside = (bins >= 0) & (bins < len(order))
    held = np.zeros(len(order))
    np.maximum.at(held, bins[inside], amplitude[inside])
    return np.maximum(held, between)


def between_lines(order: Array, amplitude: Array) -> float:
    """Returns the median amplitude away from whole orders."""
    off = np.abs(order - np.round(order)) > _NEAR_LINE
    return float(np.median(amplitude[off])) if off.any() else 0.0


def _residual_amplitude(
    tracing: Tracing, used: list[Subject], order: Array, row: int, *, after: bool
) -> Array:
    power = np.zeros(len(order))
    for each in used:
        prediction = each.after if after else each.before
        power += (
            order_spectrum(prediction.residual_n[:, row], prediction.time_s, prediction.speed_rev_s, order)
            ** 2
        )
    return np.sqrt(power / len(used))


def _label_lines(
    axes: Axes, order: Array, old: Array, new: Array, level: float, unit: str, both: bool
) -> None:
    """Writes the amplitudes beside the highest lines, and the level between the lines above the axes."""
    whole = np.arange(max(1, int(np.ceil(order[0]))), int(order[-1]) + 1)
    heights = []
    for each in whole:
        near = np.abs(order - each) < _NEAR_LINE
        if near.any():
            heights.append((max(old[near].max(), new[near].max()), each, old[near].max(), new[near].max()))
    heights = sorted(heights, reverse=True)[:_LABELLED]
    apart = _CROWDED * (order[-1] - order[0])
    placed: list[tuple[float, int]] = []
    for height, each, first, last in heights:
        crowded = any(
            abs(each - at) < apart and abs(height - top) < _CROWDED * heights[0][0] for top, at in placed
        )
        if crowded or height < max(4.0 * level, 0.04 * heights[0][0]):
            continue
        placed.append((height, int(each)))
        said = f"{number(first, 2)} → {number(last, 2)}" if both else number(first, 2)
        axes.annotate(
            said, (each, height), xytext=(7, -1), textcoords="offset points", fontsize=8, va="center"
        )
    axes.set_title(
        f"between the lines: {number(level, 2)} {unit}", loc="right", fontsize=8, color=FLOOR, pad=3
    )


def _mark_tooth_passing(
    axes: Axes, tracing: Tracing, used: list[Subject], order: Array, named_: bool
) -> None:
    """Marks multiples of tooth passing; the order it folds to where it lies above half the sampling rate."""
    teeth, rate = tracing.dataset.tool.teeth, tracing.dataset.sensor.sample_rate_hz
    last = int(order[-1] / teeth) if order[-1] >= teeth else 0
    direct: list[tuple[float, str]] = [
        (teeth * k, "tooth passing" if k == 1 else f"{k} ×") for k in range(1, min(last, 40) + 1)
    ]
    if not direct:
        speeds = np.array([each.before.speed_rev_s for each in used])
        speeds = speeds[teeth * speeds > 0.5 * rate]
        folds = folded_hz(teeth * speeds, rate) / speeds
        seen = [fold for fold in np.unique(np.round(folds, 1)) if order[0] <= fold <= order[-1]]
        direct = [(float(fold), "tooth passing, folded") for fold in seen[:_FOLDS_MARKED]]
    for index, (at, label) in enumerate(direct):
        axes.axvline(at, color=MEASURED, linewidth=0.7, linestyle=(0, (1, 2)))
        inside = at < order[0] + 0.96 * (order[-1] - order[0])
        if named_ and inside and (index == 0 or (last and len(direct) <= 12)):
            axes.annotate(
                label,
                (at, 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(3, -3),
                textcoords="offset points",
                fontsize=8,
                va="top",
                color=MEASURED,
            )
