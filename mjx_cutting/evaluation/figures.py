"""Figures of an evaluation: reward distributions, reward terms by sheet, actions over time, training curves.

Figures are made without pyplot, so nothing global is touched and no display is needed. Forces are shown
with a mean over 50 policy steps (1 s), as in the paper.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mjx_cutting import _files
from mjx_cutting.evaluation.metrics import TERMS
from mjx_cutting.evaluation.rollouts import Rollouts
from mjx_cutting.evaluation.statistics import mean_interval
from mjx_cutting.learning.policy import PolicyDescription

COLOURS = ("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#bbbbbb", "#000000")
FORCE_WINDOW = 50


def save(figure: Any, path: Path, dots_per_inch: float = 150) -> Path:
    """Write a figure to a file (the name's ending decides the kind), atomically, and return the path."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format=Path(path).suffix.lstrip(".") or "png", dpi=dots_per_inch)
    return _files.write_atomic(path, buffer.getvalue())


def violins(rewards: Mapping[str, Mapping[str, np.ndarray]], title: str = "Reward of an episode") -> Any:
    """Return a figure with one group of violins a strategy, one violin a domain; dots are the single
    rollouts.

    Arguments:
        rewards: domain -> strategy -> [rollout]; every domain has the same strategies.
        title: above the axes.
    """
    domains = list(rewards)
    strategies = list(rewards[domains[0]])
    figure, axes = _figure(max(6.0, 1.6 * len(strategies) + 1.5), 4.2)
    width = 0.8 / len(domains)
    spread = np.random.default_rng(0)
    for d, domain in enumerate(domains):
        for s, strategy in enumerate(strategies):
            values = np.asarray(rewards[domain][strategy], float)
            values = values[np.isfinite(values)]
            at = s + (d - (len(domains) - 1) / 2) * width
            if values.size > 1 and np.ptp(values) > 0:
                parts = axes.violinplot(values, [at], widths=0.9 * width, showextrema=False)
                for body in parts["bodies"]:
                    body.set(facecolor=COLOURS[d], alpha=0.4)
            jitter = spread.uniform(-0.12, 0.12, values.size) * width
            axes.plot(at + jitter, values, ".", ms=2.5, color=COLOURS[d], alpha=0.7)
            if values.size:
                axes.hlines(np.mean(values), at - 0.35 * width, at + 0.35 * width, color=COLOURS[d], lw=1.8)
        axes.plot([], [], color=COLOURS[d], lw=6, alpha=0.5, label=domain)
    axes.set_xticks(range(len(strategies)), [s.replace("_", " ") for s in strategies])
    axes.set(ylabel="episode reward", title=title)
    axes.grid(axis="y", alpha=0.3)
    axes.legend(title="domain", frameon=False)
    return figure


def training_curves(curves: Mapping[str, tuple[np.ndarray, np.ndarray]], smooth: int = 1) -> Any:
    """Return a figure of reward against policy steps, with the mean over seeds and its 95 % band.

    Arguments:
        curves: name -> (steps [T], episode reward [T] or [T, seeds]); NaN where no episode ended.
        smooth: entries over which a running mean is taken.
    """
    figure, axes = _figure(6.5, 4.0)
    for k, (name, (steps, rewards)) in enumerate(curves.items()):
        values = np.asarray(rewards, float)
        values = values[:, None] if values.ndim == 1 else values
        values = np.stack([_running(column, smooth) for column in values.T], axis=1)
        keep = np.isfinite(values).all(axis=1)
        mean, low, high = mean_interval(values[keep], axis=1)
        x = np.asarray(steps)[keep]
        label = f"{name} ({values.shape[1]} seed{'s' if values.shape[1] > 1 else ''})"
        axes.plot(x, mean, color=COLOURS[k % len(COLOURS)], label=label)
        if values.shape[1] > 1:
            axes.fill_between(x, low, high, color=COLOURS[k % len(COLOURS)], alpha=0.25, lw=0)
    axes.set(xlabel="policy steps", ylabel="episode reward", title="Training")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    return figure


def over_time(
    rollouts: Mapping[str, Rollouts], description: PolicyDescription, disturbed: bool = True
) -> Any:
    """Return a figure of set-points and states over time: mean over rollouts, and the band from 10 to 90 %.

    Arguments:
        rollouts: strategy -> rollouts.
        description: of the policies, for names, units and scales of the observation.
        disturbed: show the observation with the disturbance, not the clean one.
    """
    rows = [
        (name, unit, scale, i)
        for i, (name, unit, scale) in enumerate(
            zip(
                description.observation_names,
                description.observation_units,
                description.observation_scales,
                strict=True,
            )
        )
        if not name.startswith("velocity")
    ]
    columns = 3
    figure, axes = _figure(11.5, 2.1 * -(-len(rows) // columns), -(-len(rows) // columns), columns)
    for axis, (name, unit, scale, i) in zip(axes.flat, rows, strict=False):
        for k, (strategy, r) in enumerate(rollouts.items()):
            seen = r.observation if disturbed or r.clean is None else r.clean
            values = np.where(r.active, seen[..., i] * scale, np.nan)
            if name.startswith("force"):
                values = np.stack([_running(column, FORCE_WINDOW) for column in values.T], axis=1)
            enough = r.active.sum(axis=1) >= max(1, r.active.shape[1] // 4)
            time = np.arange(len(values))[enough] * r.period_s
            colour = COLOURS[k % len(COLOURS)]
            low, high = np.nanpercentile(values[enough], [10, 90], axis=1)
            axis.plot(time, np.nanmean(values[enough], axis=1), color=colour, lw=1.2, label=strategy)
            axis.fill_between(time, low, high, color=colour, alpha=0.15, lw=0)
        axis.set_title(f"{name.replace('_', ' ')}, {unit}", fontsize=9)
        axis.tick_params(labelsize=7)
        axis.grid(alpha=0.3)
    for axis in axes.flat[len(rows) :]:
        axis.set_axis_off()
    for axis in axes[-1]:
        axis.set_xlabel("time, s", fontsize=8)
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False, fontsize=8)
    return figure


def reward_terms(
    tables: Mapping[str, Mapping[str, Mapping[str, float]]], sheets: Sequence[str], title: str = ""
) -> Any:
    """Return a figure of the mean reward terms by sheet and strategy, with the share of completed episodes.

    Arguments:
        tables: strategy -> sheet -> measure -> mean (`metrics.by_material`).
        sheets: in this order; those without rollouts are left empty.
        title: above the axes.
    """
    return reward_terms_by_domain({title: tables}, sheets)


def reward_terms_by_domain(
    domains: Mapping[str, Mapping[str, Mapping[str, Mapping[str, float]]]], sheets: Sequence[str]
) -> Any:
    """Return the figure of `reward_terms` with a row for each of several domains: title -> tables."""
    widest = max(len(tables) for tables in domains.values())
    figure, rows = _figure(max(7.0, 0.3 * widest * len(sheets)), 4.4 * len(domains), len(domains))
    named: dict[str, Any] = {}
    for axes, (title, tables) in zip(np.ravel(rows), domains.items(), strict=True):
        _draw_terms(axes, tables, sheets, title)
        handles, labels = axes.get_legend_handles_labels()
        named |= dict(zip(labels, handles, strict=True))
    figure.legend(
        list(named.values()),
        list(named),
        frameon=False,
        fontsize=8,
        ncols=len(named),
        loc="outside upper center",
    )
    return figure


def _draw_terms(
    axes: Any, tables: Mapping[str, Mapping[str, Mapping[str, float]]], sheets: Sequence[str], title: str
) -> None:
    strategies = list(tables)
    width = 0.8 / len(strategies)
    terms = [t for t in TERMS if any(t in tables[s].get(m, {}) for s in strategies for m in sheets)]
    tops = [
        sum(max(tables[s][m].get(t, 0), 0) for t in terms)
        for s in strategies
        for m in sheets
        if m in tables[s]
    ]
    for m, sheet in enumerate(sheets):
        for s, strategy in enumerate(strategies):
            row = tables[strategy].get(sheet)
            if row is None:
                continue
            at = m + (s - (len(strategies) - 1) / 2) * width
            above = below = 0.0
            for term in terms:
                value = row.get(term, 0.0)
                base = above if value >= 0 else below
                colour = COLOURS[TERMS.index(term)]
                axes.bar(at, value, 0.9 * width, bottom=base, color=colour, edgecolor="white", lw=0.3)
                above, below = (above + value, below) if value >= 0 else (above, below + value)
            axes.plot(at, row["reward"], "k_", ms=60 * width, mew=1.5)
            mark = "" if row["completed"] > 0.999 else f"\n{100 * row['completed']:.0f} % done"
            axes.text(
                at,
                above + 0.02,
                strategy.replace("_", " ") + mark,
                rotation=90,
                fontsize=6,
                ha="center",
                va="bottom",
            )
    for term in terms:
        axes.bar(0, 0, 0, color=COLOURS[TERMS.index(term)], label=term.removeprefix("reward_"))
    axes.plot([], [], "k_", ms=10, label="sum")
    axes.margins(y=0.02)
    low, high = axes.get_ylim()
    axes.set_ylim(low, max([high, *tops]) + 0.35 * (high - low))
    axes.axhline(0, color="black", lw=0.6)
    axes.set_xlim(-0.6, len(sheets) - 0.4)
    axes.set_xticks(range(len(sheets)), sheets)
    axes.set(ylabel="reward of an episode, by term", title=title)


def _figure(width: float, height: float, rows: int = 1, columns: int = 1) -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=rows == 1 and columns == 1)


def _running(values: np.ndarray, width: int) -> np.ndarray:
    """Mean of the last `width` entries that are not NaN; NaN where the entry itself is."""
    here = np.isfinite(values)
    total = np.concatenate([[0.0], np.cumsum(np.where(here, values, 0.0))])
    count = np.concatenate([[0], np.cumsum(here)])
    low = np.maximum(np.arange(len(values)) + 1 - width, 0)
    high = np.arange(len(values)) + 1
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(here, (total[high] - total[low]) / (count[high] - count[low]), np.nan)
