"""`mjx-cutting fit-gp`: what a force model leaves unexplained, for the simulation to draw from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from mjx_cutting.cli.folder import run_folder

if TYPE_CHECKING:
    from mjx_cutting.disturbance import DisturbanceGP


@dataclass(frozen=True)
class FitGp:
    """Fits a periodic Gaussian process to what a force model leaves of measured trials; writes gp.npz.

    The fit is deterministic, so there is no --seed.
    """

    dataset: Annotated[str, tyro.conf.Positional]
    """A name of `mjx-cutting data list`, or a folder in the dataset format."""

    model: Path | None = None
    """model.json of `mjx-cutting trace` on these trials or on trials like them. Default: none, the measured
    force itself is fitted."""

    out: Path | None = None
    """Folder to write, new or empty. Default: runs/<UTC time>-fit-gp."""

    band: tuple[float, float] | None = None
    """Band in which the force sensor is trusted, Hz. Default: as in trace."""

    clock: Literal["auto", "angle", "time"] = "auto"
    """What the trials repeat in: the spindle angle, or the time since the cut began. auto: the angle where it
    was measured or a model gives it."""

    warp: bool = False
    """With --clock time: warp the trials onto each other, after the shift."""

    max_lag_s: float | None = None
    """With --clock time: largest shift looked for, s. Default: a quarter of the shortest trial."""

    warp_radius_s: float | None = None
    """With --warp: bound on the warp, s. Default: none."""

    frequency_range: tuple[float, float] | None = None
    """Where to look for the frequency, Hz. Default: from two periods in the record to just past the spindle
    speed; with --clock time, to a twentieth of the sample rate."""

    pooled: bool = False
    """Take all trials for one process, without one of each trial's own beside it."""

    quasi_periodic: bool = False
    """Let the shape drift over the record."""

    def run(self) -> None:
        """Prints what was fitted, and where it lies."""
        from rich.console import Console

        from mjx_cutting.learning.environment import load_model
        from mjx_cutting.loop.fit_gp import fit_gp
        from mjx_cutting.trials import resolve

        dataset = resolve(self.dataset)
        model = None if self.model is None else load_model(self.model)
        with (
            run_folder(self.out, "fit-gp", self, None) as (staged, folder),
            Console(stderr=True).status("starting") as status,
        ):
            fitted = fit_gp(
                dataset,
                model,
                staged,
                band_hz=self.band,
                clock=self.clock,
                warp=self.warp,
                max_lag_s=self.max_lag_s,
                warp_radius_s=self.warp_radius_s,
                frequency_range_hz=self.frequency_range,
                trial_effects=not self.pooled and len(dataset.trials) > 1,
                quasi_periodic=self.quasi_periodic,
                progress=status.update,
            )
        for warning in fitted.gp.warnings:
            print(f"warning: {warning}")
        print(_summary(fitted.gp))
        print(f"disturbance: {folder / 'gp.npz'}")


def _summary(gp: DisturbanceGP) -> str:
    lines = [f"period {gp.period_s:.6g} s ({gp.frequency_hz:.6g} Hz) over {gp.trials} trials"]
    for i, axis in enumerate(gp.axes):
        lines.append(
            f"  {axis}: {gp.common_std_n[i]:.3g} N common, {gp.trial_std_n[i]:.3g} N of a trial's own, "
            f"{gp.noise_std_n[i]:.3g} N noise; length {gp.length[i]:.3g}"
        )
    return "\n".join(lines)
