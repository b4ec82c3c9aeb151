"""`mjx-cutting cell`: the virtual cell, a stand-in for robot, tool and sheet at a policy server."""

from __future__ import annotations

import signal
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mjx_cutting.deploy.virtual_cell import Cell


@dataclass(frozen=True)
class CellVerb:
    """Runs cuts in the virtual cell, for a policy server in real time or for a policy file in lock step;
    prints one line of JSON a trial."""

    material: str = "aluminium"
    """Sheet: foam, plastic, cardboard, mica or aluminium."""

    effects: Path | None = None
    """TOML file with hidden effects (docs/virtual_cell.md). Default: none."""

    server: str = "127.0.0.1:50500"
    """HOST:PORT of the policy server, spoken to in real time."""

    fast: Path | None = None
    """Exported policy to be served in this process instead, on the cell's clock: no socket, no waiting."""

    key_file: Path | None = None
    """File with the key shared with the server. Default: unsigned packets."""

    trials: int = 1
    """Cuts, one after another with the same tool, each in a new sheet."""

    approach_m: float = 0.030
    """Path before the sheet, m."""

    cut_m: float = 0.220
    """Path over the sheet, m."""

    seed: int = 0
    """Of sensor noise, spindle angle, session numbers and network."""

    longest_s: float = 120.0
    """A trial is given up after so many seconds of the cell's time."""

    def run(self) -> int:
        """Returns 0; 1 where a cut was not finished."""
        from mjx_cutting.deploy.virtual_cell import Cell, CellConfig, Hidden, load

        if self.trials < 1:
            raise ValueError(f"got --trials {self.trials}; expected at least 1")
        key = self.key_file.read_bytes().strip() if self.key_file else None
        config = CellConfig(
            material=self.material, approach_m=self.approach_m, cut_m=self.cut_m, seed=self.seed
        )
        cell = Cell(config, load(self.effects) if self.effects else Hidden(), key)
        return self._lockstep(cell) if self.fast else self._realtime(cell)

    def _realtime(self, cell: Cell) -> int:
        from mjx_cutting.deploy.virtual_cell.process import Process, address

        process = Process(cell, address(self.server))
        ended: list[int] = []
        before = {each: signal.signal(each, lambda number, _: ended.append(number)) for each in _SIGNALS}
        finished = True
        try:
            for trial in range(self.trials):
                if trial:
                    cell.new_trial()
                outcome = process.run(longest_s=self.longest_s, stopped=lambda: bool(ended))
                print(outcome.line(), flush=True)
                finished &= outcome.score["completed"]
                if ended:
                    break
        finally:
            process.close()
            for number, handler in before.items():
                signal.signal(number, handler)
        return 0 if finished else 1

    def _lockstep(self, cell: Cell) -> int:
        import json

        from mjx_cutting.deploy.export_check import Lockstep
        from mjx_cutting.deploy.runtime import PolicyRuntime

        if self.fast is None or self.key_file is not None:
            raise ValueError("got --key-file with --fast; expected it with a server only: no packet leaves")
        lockstep = Lockstep(cell, PolicyRuntime.load(self.fast))
        finished = True
        for _ in range(self.trials):
            flight = lockstep.fly(longest_s=self.longest_s)
            told: dict[str, Any] = {"score": flight.score, "log": flight.log}
            print(json.dumps(told), flush=True)
            finished &= flight.score["completed"]
        return 0 if finished else 1


_SIGNALS = (signal.SIGINT, signal.SIGTERM)
