"""`mjx-cutting demo`: the whole loop once, from measured trials to an exported, adapted policy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from mjx_cutting.loop.demo import DemoConfig


@dataclass(frozen=True)
class Demo(DemoConfig):
    """Traces, simulates, trains, adapts, evaluates and exports at small size; ends in one report.html."""

    preset: Literal["smoke", "demo"] = "demo"

    def run(self) -> None:
        """Prints where the report lies."""
        from mjx_cutting.loop.demo import run

        print(f"report: {run(self)}")
