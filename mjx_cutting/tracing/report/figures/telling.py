"""Lines of the force against the condition that tells effects apart.

The line at one revolution is flat in feed under runout and rises with feed where the pitch is unequal or a
tooth is broken; tooth passing always rises. Measured lines stand beside those of the base and of the final
model. Where the feed is the same in all trials, the first condition that differs takes its place.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mjx_cutting._report.style import AFTER, BEFORE, MEASURED, legend_above, new_figure, style_axes
from mjx_cutting.tracing.report.figures.subject import (
    Array,
    Subject,
    after_label,
    force_unit,
    line_amplitude,
    named,
    subjects,
)
from mjx_cutting.tracing.told import Tracing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BIG_MARKS = 30
_PREFERRED = {
    "flank_wear": "cut length",
    "thermal_drift": "clock time",
    "unbalance": "spindle speed",
    "side_friction": "radial depth",
    "static_compliance": "radial depth",
}


def telling_figure(tracing: Tracing) -> Figure | None:
    """Returns the figure; None where no condition differs between the trials or no line lies in the band."""
    found = subjects(tracing)
    chosen = covariate(tracing, found)
    orders = _orders_in_band(tracing, found)
    if chosen is None or not orders:
        return None
    name, unit, values = chosen
    figure = new_figure(3.5)
    grid = figure.subplots(1, len(orders), squeeze=False)[0]
    rank = np.argsort(values, kind="stable")
    joined = len(np.unique(values)) == len(values)
    few = len(found) <= _BIG_MARKS
    small, line = (5.0, 1.6) if few else (2.5, 1.0)
    for axes, (order, title) in zip(grid, orders, strict=True):
        measured, old, new = (_amplitudes(found, order, which) for which in ("measured", "before", "after"))
        drawn: list[tuple[Any, str, str, Any, str]] = [(old, BEFORE, "D", (0, (4, 2)), "before: base model")]
        if named(tracing):
            drawn.append((new, AFTER, "s", "-", after_label(tracing)))
        for values_n, colour, marker, style, label in drawn:
            axes.plot(
                values[rank],
                values_n[rank],
                color=colour,
                marker=marker,
                markersize=small,
                markerfacecolor="white" if marker == "D" else colour,
                linewidth=line,
                linestyle=style if joined else "none",
                label=label,
            )
        axes.plot(
            values,
            measured,
            color=MEASURED,
            marker="o",
            markersize=1.9 * small,
            markerfacecolor="none",
            markeredgewidth=1.6 if few else 0.8,
            linestyle="none",
            label="measured",
        )
        style_axes(axes, title=title, x=f"{name} ({unit})", y=f"amplitude, x and y ({force_unit(tracing)})")
        top = max(float(np.max(each)) for each in (measured, old, new))
        axes.set_ylim(0.0, 1.12 * max(top, 1e-9))
        low, high = min(0.0, float(values.min())), float(values.max())
        axes.set_xlim(low, high + 0.06 * (high - low))
        axes.locator_params(axis="x", nbins=6)
    handles, labels = grid[0].get_legend_handles_labels()
    legend_above(figure, handles, labels)
    return figure


def covariate(tracing: Tracing, found: Sequence[Subject]) -> tuple[str, str, Array] | None:
    """Returns (name, unit, values [R]) of the condition to draw against; None where nothing differs."""
    conditions: dict[str, tuple[str, list[float]]] = {
        "feed per tooth": ("mm", [1e3 * each.feed_per_tooth_m for each in found]),
        "spindle speed": ("rpm", [60.0 * each.before.speed_rev_s for each in found]),
        "radial depth": ("mm", [1e3 * each.trial.radial_depth_m for each in found]),
        "axial width": ("mm", [1e3 * each.trial.axial_width_m for each in found]),
        "cut length": ("m", [each.trial.cut_length_before_m for each in found]),
        "clock time": ("min", [each.trial.clock_start_s / 60.0 for each in found]),
    }
    wanted = [_PREFERRED[e["name"]] for e in tracing.verdict["effects"] if e["name"] in _PREFERRED]
    for name in [*wanted, *conditions]:
        unit, listed = conditions[name]
        values = np.asarray(listed)
        if np.ptp(values) > 0.02 * np.abs(values).max():
            return name, unit, values
    return None


def _orders_in_band(tracing: Tracing, found: Sequence[Subject]) -> list[tuple[int, str]]:
    teeth = tracing.dataset.tool.teeth
    low, high = tracing.lines.band_hz
    high = min(high, 0.5 * tracing.dataset.sensor.sample_rate_hz)
    speeds = [each.before.speed_rev_s for each in found]
    lines = [(1, "once per revolution"), (teeth, "tooth passing")]
    lines = lines[1:] if teeth == 1 else lines
    return [
        (order, f"{title} (order {order})")
        for order, title in lines
        if low < order * min(speeds) and order * max(speeds) <= high
    ]


def _amplitudes(found: Sequence[Subject], order: int, which: str) -> Array:
    records = {
        "measured": lambda each: each.after.measured_n,
        "before": lambda each: each.before.predicted_n,
        "after": lambda each: each.after.predicted_n,
    }
    return np.array(
        [line_amplitude(each.after.angle_rad, records[which](each)[:, :2], order) for each in found]
    )
