"""`mjx-cutting evaluate`: what policies are worth, beside the fixed baseline."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from mjx_cutting.evaluation.evaluate import EvaluateConfig
from mjx_cutting.sim.config import EnvConfig

SHOWN = {
    "reward": "reward",
    "time_s": "time s",
    "path_deviation_mm": "deviation mm",
    "load_n": "load N",
    "mrv_mm3": "MRV mm^3",
    "completed": "completed",
}


@dataclass(frozen=True)
class Evaluate(EvaluateConfig):
    """Rolls out policies and the baseline on the same episodes; writes tables, tests and figures."""

    policies: Annotated[tuple[Path, ...], tyro.conf.Positional]
    env: tyro.conf.Suppress[EnvConfig | None] = None

    def run(self) -> None:
        """Prints the mean of each measure by domain and strategy."""
        from mjx_cutting.evaluation.evaluate import evaluate

        cell = None
        if "cell" in self.domains:
            from mjx_cutting.loop.cell_domain import cell_domain

            cell = cell_domain(self.effects, self.cuts, self.seed, lambda line: print(line, file=sys.stderr))
        folder = evaluate(self, cell)
        _show(json.loads((folder / "evaluation.json").read_text()))
        print(f"evaluated: {folder}")


def _show(summary: dict[str, Any]) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    for domain, found in summary.items():
        table = Table(title=f"{domain} domain, mean over episodes", box=SIMPLE_HEAD)
        table.add_column("strategy")
        for heading in SHOWN.values():
            table.add_column(heading, justify="right")
        for name, strategy in found["strategies"].items():
            means = strategy["by_material"]["all"]
            table.add_row(name, *(_number(means[key]) for key in SHOWN))
        Console().print(table)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
