"""The figures of the paper's experiment, small enough to be committed beside its results file.

<results>_reward.png     distributions of the episode reward, a violin a domain
<results>_terms.png      terms of the reward by sheet and strategy, with the share that completed the path
<results>_training.png   training curves, mean over seeds with its 95 % band
<results>_over_time.png  actions and states over time on the surrogate
<results>_table.png      time, path deviation, load and MRV by sheet, beside the paper's robot
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.published import MEASURES, TABLE
from mjx_cutting import _files
from mjx_cutting.evaluation import figures
from mjx_cutting.evaluation.rollouts import Rollouts

MOST_BYTES = 150_000
SHOWN_OVER_TIME = ("expert", "bc", "dagger", "fine_tune", "re_train")


def draw(
    results: Path,
    summary: Mapping[str, Any],
    rolled: Mapping[str, Mapping[str, Rollouts]],
    curves: Mapping[str, Any],
    description: Any,
    sheets: Sequence[str],
) -> list[Path]:
    """Write the figures beside a results file and return their paths.

    Arguments:
        results: the results file.
        summary, rolled: summaries and rollouts by domain.
        curves: training -> (policy steps [T], episode reward [T, seeds]).
        description: of the policies.
        sheets: in the order in which they are shown.
    """
    rewards = {d: {name: r.total("reward") for name, r in group.items()} for d, group in rolled.items()}
    tables = {
        f"{domain} domain": {name: s["by_material"] for name, s in told["strategies"].items()}
        for domain, told in summary.items()
    }
    shown = {name: r for name, r in rolled["surrogate"].items() if name in SHOWN_OVER_TIME}
    last = list(summary)[-1]
    made = {
        "reward": figures.violins(rewards),
        "terms": figures.reward_terms_by_domain(tables, sheets),
        "training": figures.training_curves(curves, smooth=20),
        "over_time": figures.over_time(shown, description),
        "table": table(summary[last]["strategies"], sheets, f"{last} domain"),
    }
    stem = results.with_suffix("")
    return [save(figure, Path(f"{stem}_{name}.png")) for name, figure in made.items()]


def table(strategies: Mapping[str, Any], sheets: Sequence[str], title: str) -> Any:
    """Return the table of means by strategy and sheet as a figure; the paper's row is beneath ours."""
    from matplotlib.figure import Figure

    rows, cells = [], []
    for name, told in strategies.items():
        rows.append(name.replace("_", " "))
        cells.append([_cell(told["by_material"].get(sheet)) for sheet in sheets])
        if name in TABLE:
            rows.append("paper")
            cells.append([_cell(TABLE[name].get(sheet)) for sheet in sheets])
    figure = Figure(figsize=(1.6 + 2.3 * len(sheets), 0.7 + 0.24 * len(rows)), layout="constrained")
    axes = figure.subplots()
    axes.set_axis_off()
    axes.set_title(f"time s / path deviation mm / load N / MRV mm$^3$: {title}, and the paper's robot")
    drawn = axes.table(cells, rowLabels=rows, colLabels=list(sheets), cellLoc="center", loc="upper center")
    drawn.auto_set_font_size(False)
    drawn.set_fontsize(8)
    for (row, _), cell in drawn.get_celld().items():
        cell.set(linewidth=0.3)
        if row > 0 and rows[row - 1] == "paper":
            cell.get_text().set_color("0.45")
    return figure


def save(figure: Any, path: Path) -> Path:
    """Write a figure as a PNG of 256 colours, coarser where it would be too large, and return the path."""
    from PIL import Image

    for dots_per_inch in (110, 90, 75, 60, 50):
        drawn, small = io.BytesIO(), io.BytesIO()
        figure.savefig(drawn, format="png", dpi=dots_per_inch)
        Image.open(drawn).convert("RGB").quantize(256).save(small, format="png", optimize=True)
        if small.tell() <= MOST_BYTES:
            break
    return _files.write_atomic(path, small.getvalue())


def _cell(row: Mapping[str, float] | None) -> str:
    return "-" if row is None else " / ".join(f"{row[name]:.3g}" for name in MEASURES)
