"""What a training run tells: a bar on the terminal, metrics.jsonl in the run folder, TensorBoard where
asked for.

A line of metrics.jsonl holds iteration, steps, wall_s, steps_per_s and the learner's metrics; with several
seeds a metric is a list with one entry a seed. Steps per second are those since the last line, so a line
written while the machine was busy shows it.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from mjx_cutting import _files, runs

METRICS = "metrics.jsonl"


class Reporter:
    """A context in which `report` shows and records the metrics of one iteration after another.

    Arguments:
        run: run folder.
        title: what is being trained, shown before the bar.
        iterations: iterations of the whole run.
        done: iterations behind a resumed run.
        quiet: no bar.
        tensorboard: write TensorBoard scalars too (needs tensorboardX).
    """

    def __init__(
        self,
        run: Path,
        title: str,
        iterations: int,
        done: int = 0,
        quiet: bool = False,
        tensorboard: bool = False,
    ):
        self._run = Path(run)
        self._wall_s = _wall_s(self._run) if done else 0.0
        self._last = time.monotonic()
        self._shown: dict[str, str] = {}
        self._writer = _tensorboard(self._run) if tensorboard else None
        self._bar = None if quiet else _bar()
        self._task = None
        if self._bar is not None:
            self._task = self._bar.add_task(title, total=iterations, completed=done, figures="")

    def __enter__(self) -> Reporter:
        if self._bar is not None:
            self._bar.start()
        self._last = time.monotonic()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
        if self._writer is not None:
            self._writer.close()

    def report(self, iteration: int, steps: int, new_steps: int, metrics: Mapping[str, Any]) -> None:
        """Show and record one iteration.

        Arguments:
            iteration: iterations done.
            steps: policy steps done.
            new_steps: policy steps since the last report.
            metrics: scalars, or one array entry a seed; not finite is recorded as null.
        """
        now = time.monotonic()
        self._wall_s += now - self._last
        rate = new_steps / max(now - self._last, 1e-9)
        self._last = now
        line = {
            "iteration": iteration,
            "steps": steps,
            "wall_s": round(self._wall_s, 3),
            "steps_per_s": round(rate, 1),
            **{name: np.asarray(value, float).tolist() for name, value in metrics.items()},
        }
        runs.append_metrics(self._run, line)
        if self._writer is not None:
            for name, value in metrics.items():
                if np.all(np.isfinite(value)):
                    self._writer.add_scalar(name, float(np.mean(value)), steps)
        if self._bar is not None and self._task is not None:
            for name in ("episode_return", "loss", "beta"):
                finite = np.asarray(metrics.get(name, np.nan), float)
                finite = finite[np.isfinite(finite)]
                if finite.size:  # else what was shown before stays
                    self._shown[name] = f"{name.replace('episode_', '')} {float(np.mean(finite)):.3f}"
            figures = ", ".join([*self._shown.values(), f"{rate:,.0f} steps/s"])
            self._bar.update(self._task, completed=iteration, figures=figures)


def rewind(run: Path, iteration: int) -> None:
    """Drop the lines of metrics.jsonl beyond an iteration, which a resumed run will write again."""
    path = Path(run) / METRICS
    if path.is_file():
        kept = [line for line in read_lines(path) if line.get("iteration", 0) <= iteration]
        _files.write_atomic(path, "".join(json.dumps(line) + "\n" for line in kept))


def read_lines(path: Path) -> list[dict[str, Any]]:
    """Return the lines of a metrics.jsonl; a last line that was cut off by a kill is left out."""
    lines = []
    for text in Path(path).read_text().splitlines():
        try:
            lines.append(json.loads(text))
        except ValueError:
            break
    return lines


def _wall_s(run: Path) -> float:
    path = run / METRICS
    lines = read_lines(path) if path.is_file() else []
    return float(lines[-1].get("wall_s", 0.0)) if lines else 0.0


def _bar() -> Any:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    return Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TextColumn("{task.fields[figures]}"),
        TimeRemainingColumn(),
        console=Console(file=sys.stderr),
    )


def _tensorboard(run: Path) -> Any:
    try:
        from tensorboardX import SummaryWriter
    except ImportError as error:
        raise ValueError(
            "got tensorboard=True without the package tensorboardX; expected it installed; "
            "pip install tensorboardX, or leave tensorboard off (metrics.jsonl holds the same numbers)"
        ) from error
    return SummaryWriter(str(run / "tensorboard"))
