"""`mjx-cutting loop`: serve, record, trace, adapt and serve again, on the virtual cell."""

from __future__ import annotations

from dataclasses import dataclass

from mjx_cutting.loop.rounds import RoundsConfig


@dataclass(frozen=True)
class Loop(RoundsConfig):
    """Closes the loop on the virtual cell: records, names what the model lacks, adapts, serves again."""

    def run(self) -> None:
        """Prints the rounds and where they lie."""
        import json

        from mjx_cutting.loop.rounds import run, table

        folder = run(self)
        print(table(json.loads((folder / "rounds.json").read_text())["rounds"]))
        print(f"rounds: {folder / 'rounds.json'}")
