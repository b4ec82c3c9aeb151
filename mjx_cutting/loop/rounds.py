"""`mjx-cutting loop`: the loop closed on the virtual cell, round after round.

    serve and record -> trace -> the effect into the simulation -> GP on the rest -> adapt -> export -> serve

Each round records at most 20 trials (steady probes, and from the second round on the adapted policy), traces
all steady cuts so far, adapts the same expert in four ways and serves each on the cell:

    direct          the expert as trained
    gp_only         DAgger under the GP of everything the base model leaves (the paper's way)
    effect_only     fine-tuned by PPO with the named effect in the simulation
    effect_and_gp   that policy, then DAgger under the GP of what the effect leaves

Where nothing is named there is no effect to add: effect_only is then the expert, effect_and_gp is gp_only.
What is hidden in the cell reaches this file through the recorded trials alone.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mjx_cutting import runs
from mjx_cutting._files import write_atomic
from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.virtual_cell import Cell, CellConfig, Hidden, load
from mjx_cutting.learning import presets
from mjx_cutting.learning.settings import require
from mjx_cutting.loop.cell_cut import cell_config, reward
from mjx_cutting.sim.config import EnvConfig

STRATEGIES = ("direct", "gp_only", "effect_only", "effect_and_gp")
CANDIDATES = ("radial_runout", "unequal_pitch", "size_effect")
BAND_HZ = (0.0, 120.0)
MOST_TRIALS = 20
SMOKE = EnvConfig(approach_m=0.005, cut_m=0.03, max_episode_s=8.0)


@dataclass(frozen=True)
class RoundsConfig:
    """Settings of the loop.

    Arguments:
        out: run folder; None: runs/<UTC time>-loop.
        material: sheet in the cell.
        effects: TOML file with the cell's hidden effects; None: none.
        expert: run folder of `mjx-cutting train`; None: one is trained first.
        rounds: times round the loop.
        trials: recorded in a round, 2 to 20.
        candidates: effects that tracing tries.
        cuts: served of each policy to compare them.
        preset: size of the trainings, "smoke", "demo", "cpu" or "full".
        udp: serve over real sockets, in real time, instead of in lock step, while recording.
        seed: of everything random.
        quiet: no progress bars.
    """

    out: Path | None = None
    material: str = "aluminium"
    effects: Path | None = None
    expert: Path | None = None
    rounds: int = 3
    trials: int = 9
    candidates: tuple[str, ...] = CANDIDATES
    cuts: int = 3
    preset: Literal["smoke", "demo", "cpu", "full"] = "cpu"
    udp: bool = False
    seed: int = 0
    quiet: bool = False

    def __post_init__(self) -> None:
        require("rounds", self.rounds, self.rounds >= 1, "at least 1")
        require("trials", self.trials, 2 <= self.trials <= MOST_TRIALS, f"2 to {MOST_TRIALS}")
        require("cuts", self.cuts, self.cuts >= 1, "at least 1")
        require("candidates", self.candidates, len(self.candidates) > 0, "at least one effect")


def run(config: RoundsConfig) -> Path:
    """Goes round the loop and returns the run folder, with rounds.json and the policies of each round.

    Raises:
        ValueError: the material, an effect or the expert is unknown, or the trials hold no steady cut.
        OSError: the run folder cannot be written.
    """
    from rich.console import Console

    hidden = load(config.effects) if config.effects else Hidden()
    Cell(CellConfig(material=config.material))  # an unknown sheet is said before any training
    folder = runs.open_run(config.out, "loop", config, config.seed)
    console = Console(stderr=True, quiet=config.quiet)
    work = _Work(config, hidden, folder, console)
    work.train()
    told: list[dict[str, Any]] = []
    for index in range(1, config.rounds + 1):
        told.append(work.round(index))
        write_atomic(folder / "rounds.json", json.dumps(runs.plain({"rounds": told}), indent=2) + "\n")
    return folder


def table(rounds: list[dict[str, Any]]) -> str:
    """The rounds as a markdown table; rewards are means over the cuts."""
    head = "| round | named | held-out error before | after | " + " | ".join(STRATEGIES) + " |"
    lines = [head, "|" + "-|" * (4 + len(STRATEGIES))]
    for each in rounds:
        named = ", ".join(each["named"]) or "nothing"
        rewards = " | ".join(f"{each['reward'][name]:.3f}" for name in STRATEGIES)
        errors = f"{each['heldout_nrmse_before']:.3f} | {each['heldout_nrmse_after']:.3f}"
        lines.append(f"| {each['round']} | {named} | {errors} | {rewards} |")
    return "\n".join(lines)


class _Work:
    """What the rounds share."""

    def __init__(self, config: RoundsConfig, hidden: Hidden, folder: Path, console: Any):
        self.config, self.hidden, self.folder, self.console = config, hidden, folder, console
        self.env = SMOKE if config.preset == "smoke" else EnvConfig()
        self.expert = Path(config.expert) if config.expert else folder / "expert"
        self.served: Artefact | None = None

    def train(self) -> None:
        """Trains the expert where none is given."""
        if self.config.expert is not None:
            from mjx_cutting.learning.train import from_stored, stored_config

            self.env = from_stored(EnvConfig, stored_config(self.expert)["env"])
            return
        from mjx_cutting.learning.train import TrainConfig, train

        size, seed = self.config.preset, self.config.seed
        train(TrainConfig(out=self.expert, seed=seed, preset=size, env=self.env, quiet=self.config.quiet))

    def round(self, index: int) -> dict[str, Any]:
        """Record, trace, adapt, serve; returns what came of it."""
        begun, seconds = time.monotonic(), dict[str, float]()
        place = self.folder / f"round{index}"

        def mark(name: str) -> None:
            seconds[name] = time.monotonic() - begun - sum(seconds.values())
            self.console.print(f"  round {index}: {name} {seconds[name]:.1f} s")

        self._record(index, place / "trials")
        mark("record")
        tracing = self._trace(place)
        mark("trace")
        runs_of = self._adapt(place, tracing)
        mark("adapt")
        scores: dict[str, list[dict[str, Any]]] = {}
        for name in STRATEGIES:
            same = next((each for each in scores if runs_of[each] == runs_of[name]), None)
            path = place / f"{name}.npz"
            scores[name] = scores[same] if same else self._serve(runs_of[name], path)
            if same:
                shutil.copyfile(place / f"{same}.npz", path)
        mark("serve")
        self.served = Artefact.load(place / "effect_and_gp.npz")
        rewards = {name: [reward(self.env, s) for s in scores[name]] for name in STRATEGIES}
        verdict = tracing.verdict
        return {
            "round": index,
            "material": self.config.material,
            "heldout_nrmse_before": verdict["before"]["heldout_nrmse"],
            "heldout_nrmse_after": verdict["after"]["heldout_nrmse"],
            "noise_floor_nrmse": verdict["noise_floor_nrmse"],
            "verdict": verdict["verdict"],
            "named": [each["name"] for each in verdict["effects"]],
            "effects": {each["name"]: each["parameters"] for each in verdict["effects"]},
            "trials": len(tracing.before),
            "reward": {name: float(np.mean(values)) for name, values in rewards.items()},
            "rewards": rewards,
            "scores": scores,
            "seconds": seconds,
        }

    def _cell(self, seed: int, cut_m: float | None = None) -> Cell:
        config = cell_config(self.env, self.config.material, seed)
        if cut_m is not None:
            config = dataclasses.replace(config, approach_m=0.005, cut_m=cut_m)
        return Cell(config, self.hidden)

    def _record(self, index: int, folder: Path) -> None:
        from mjx_cutting.deploy.export import build_run
        from mjx_cutting.loop import rounds_record as recording

        like = build_run(self.expert, check=False)
        served = [self.served] if self.served is not None else []
        probes = recording.probes(like, self.config.trials - len(served), self.config.seed + index)
        record = recording.record_udp if self.config.udp else recording.record
        cell = self._cell(self.config.seed + 100 * index, recording.PROBE_CUT_M)
        record(cell, [*probes, *served], folder, f"{self.config.material}, round {index}")

    def _trace(self, place: Path) -> Any:
        from mjx_cutting.loop.rounds_record import merged
        from mjx_cutting.tracing import save, trace

        folders = sorted(self.folder.glob("round*/trials"))
        dataset = merged(folders, self.env.surface_height_m, MOST_TRIALS)
        tracing = trace(dataset, band_hz=BAND_HZ, effects=self.config.candidates, seed=self.config.seed)
        save(tracing, place / "trace")
        return tracing

    def _adapt(self, place: Path, tracing: Any) -> dict[str, Path]:
        from mjx_cutting.learning.adapt import AdaptConfig, adapt
        from mjx_cutting.loop.transfer import fit_rest

        named = bool(tracing.verdict["effects"])
        model = place / "trace" / "model.json"
        # as many entries as in the expert's training: the value network has an input for each
        sheets = (self.config.material,) * len(self.env.materials)
        env = dataclasses.replace(self.env, materials=sheets)
        shared: dict[str, Any] = {
            "env": env,
            "seed": self.config.seed,
            "preset": self.config.preset,
            "quiet": self.config.quiet,
        }
        found = {"direct": self.expert}
        gp = fit_rest(tracing.before, self.env, place / "gp_before.npz")
        found["gp_only"] = adapt(
            AdaptConfig(expert=self.expert, strategy="dagger", gp=gp, out=place / "gp_only", **shared)
        )
        if not named:
            return {**found, "effect_only": self.expert, "effect_and_gp": found["gp_only"]}
        found["effect_only"] = adapt(
            AdaptConfig(
                expert=self.expert,
                strategy="fine_tune",
                model=model,
                ppo=presets.REFINE[self.config.preset],
                out=place / "effect_only",
                **shared,
            )
        )
        rest = fit_rest(tracing.after, self.env, place / "gp_after.npz")
        found["effect_and_gp"] = adapt(
            AdaptConfig(
                expert=found["effect_only"],
                strategy="dagger",
                gp=rest,
                model=model,
                out=place / "effect_and_gp",
                **shared,
            )
        )
        return found

    def _serve(self, policy: Path, path: Path) -> list[dict[str, Any]]:
        """Exports a policy and serves it on a cell with a new tool; the amounts of every cut."""
        from mjx_cutting.deploy.export import build_run
        from mjx_cutting.deploy.export_check import Lockstep
        from mjx_cutting.deploy.runtime import PolicyRuntime, save_verified

        save_verified(build_run(policy, check=False), path)
        lockstep = Lockstep(self._cell(self.config.seed + 7), PolicyRuntime.load(path))
        return [lockstep.fly(longest_s=self.env.max_episode_s).score for _ in range(self.config.cuts)]
