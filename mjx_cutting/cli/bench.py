"""`mjx-cutting bench`: how fast the simulation is on this machine, beside what one would use instead."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal


@dataclass(frozen=True)
class Bench:
    """Measures whole physics steps per second (dynamics, control, cutting force, sheet, sensor) over numbers
    of environments, beside a Gymnasium-style environment on C MuJoCo and bare mujoco.rollout in the same run.

    Rates are the best of several repeats: on a shared machine the others measure the neighbours.
    """

    quick: bool = False
    """Few numbers of environments and a second for each figure."""

    batches: tuple[int, ...] = ()
    """Numbers of environments. Default: 1 to 16,384 (--quick: 1, 256, 2,048)."""

    engines: tuple[Literal["fused", "mjx"], ...] = ("fused",)
    """Ours to measure; the first is compared with the peers."""

    seconds: float | None = None
    """Time for each figure, s. Default: 4 (--quick: 1)."""

    peers: bool = True
    """Measure the peers too."""

    compile_times: bool = True
    """Measure the first call in fresh processes too, without and with the compile cache."""

    json: Path | None = None
    """File for all figures, with versions and machine. Default: none."""

    plot: Path | None = None
    """Picture to write, .png, .svg or .pdf. Default: none."""

    def run(self) -> None:
        """Prints the table."""
        from rich.console import Console

        from mjx_cutting import _files
        from mjx_cutting.sim import throughput

        self._check()
        batches = self.batches or (throughput.QUICK_BATCHES if self.quick else throughput.BATCHES)
        with Console(stderr=True).status("measuring") as status:
            result = throughput.compare(
                batches,
                seconds=self.seconds or (1.0 if self.quick else 4.0),
                engines=self.engines,
                peers=self.peers,
                first_call=self.compile_times,
                say=status.update,
            )
        print(throughput.table(result))
        if self.json is not None:
            _files.write_atomic(self.json, json.dumps(result, indent=2) + "\n")
            print(f"written: {self.json}")
        if self.plot is not None:
            from mjx_cutting.sim.throughput_figure import draw

            draw(result, self.plot)
            print(f"written: {self.plot}")

    def _check(self) -> None:
        if any(batch < 1 for batch in self.batches):
            raise ValueError(f"got --batches {self.batches}; expected numbers of environments, at least 1")
        if not self.engines:
            raise ValueError("got no engine; expected fused, mjx or both")
        if self.seconds is not None and not self.seconds > 0.0:
            raise ValueError(f"got --seconds {self.seconds}; expected a time above 0 s")
        if self.plot is not None and self.plot.suffix not in (".png", ".svg", ".pdf"):
            raise ValueError(f"got --plot {self.plot}; expected a name that ends in .png, .svg or .pdf")
