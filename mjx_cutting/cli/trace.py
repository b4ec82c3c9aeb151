"""`mjx-cutting trace`: which physical effect a force model lacks on measured trials."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from mjx_cutting.cli.folder import run_folder


@dataclass(frozen=True)
class Trace:
    """Finds what the force model lacks on measured trials; writes report.html, verdict.json, model.json."""

    dataset: Annotated[str, tyro.conf.Positional]
    """A name of `mjx-cutting data list`, or a folder in the dataset format."""

    out: Path | None = None
    """Folder to write, new or empty. Default: runs/<UTC time>-trace."""

    band: tuple[float, float] | None = None
    """Band in which the force sensor is trusted, Hz. Default: up to the anti-alias filter's corner, or half
    the sample rate."""

    effects: tuple[str, ...] | None = None
    """Effects to try. Default: every registered one that these trials can test."""

    material: str | None = None
    """Material of the trials to trace. Default: that of most, where the others are unlike it, else of all."""

    seed: int = 0
    """Seed of the folds, where there are more than twelve trials."""

    def run(self) -> None:
        """Prints the verdict and where the report lies."""
        from rich.console import Console

        from mjx_cutting.tracing import save, trace
        from mjx_cutting.trials import resolve

        dataset = resolve(self.dataset)
        with (
            run_folder(self.out, "trace", self, self.seed) as (staged, folder),
            Console(stderr=True).status("starting") as status,
        ):
            tracing = trace(
                dataset,
                band_hz=self.band,
                effects=self.effects,
                material=self.material,
                seed=self.seed,
                progress=status.update,
            )
            status.update("writing the report")
            save(tracing, staged)
        print(_told(tracing.verdict))
        print(f"report: {folder / 'report.html'}")


def _told(verdict: dict[str, Any]) -> str:
    before, after = verdict["before"]["heldout_nrmse"], verdict["after"]["heldout_nrmse"]
    lines = [f"{verdict['verdict']}: held-out error {before:.3f} before, {after:.3f} after"]
    for effect in verdict["effects"]:
        lines.append(f"  {effect['name']}: gain {effect['heldout_gain']:.3f}")
        for name, one in effect["parameters"].items():
            lines.append(
                f"    {name} {one['value']:.4g} ({one['low']:.4g} to {one['high']:.4g}) {one['unit']}"
            )
        if effect.get("runner_up"):
            runner_up = effect["runner_up"]
            lines.append(f"    runner-up {runner_up['name']}: {runner_up['heldout_nrmse']:.3f}")
    for pair in verdict["ambiguous"]:
        names = " or ".join(pair["names"])
        lines.append(f"  ambiguous: {names}; what would separate them: {pair['separating_trial']}")
    for one in verdict["left_out"]:
        lines.append(f"  left out {one['file']}: {one['reason']}")
    return "\n".join(lines)
