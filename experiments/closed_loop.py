"""Does naming the missing effect pay? The loop closed on the virtual cell, over sheets and hidden effects.

    python -m experiments.closed_loop --preset cpu

One expert is trained in the plain simulation; for each sheet and each set of hidden effects it goes round the
loop (mjx_cutting.loop.rounds). Results: closed_loop.json and closed_loop.png, written after every cell, so an
experiment that was stopped goes on where it stood. The reward is the simulation's, of the last round's cuts
in the cell; nothing that is hidden reaches the policies but through the recorded trials.
"""

from __future__ import annotations

import dataclasses
import json
import platform
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.launch import launch
from mjx_cutting import runs
from mjx_cutting._files import write_atomic

HIDDEN: dict[str, dict[str, Any]] = {
    "runout": {"radial_runout": {"offset_m": 1.2e-5, "angle_rad": 0.7}},
    "uneven teeth": {
        "unequal_pitch": {"error_rad": [0.0, 0.05, -0.03, 0.04, -0.06, 0.02, 0.05, -0.04, -0.02, 0.03] * 2},
        "resistance": {"chip": 1.2, "edge": 0.9},
    },
    "many": {
        "radial_runout": {"offset_m": 8e-6, "angle_rad": -1.1},
        "wear": {"per_m": 0.1},
        "robot_mode": {"frequency_hz": [24.0, 31.0], "damping": 0.05, "mass_kg": 40.0},
        "sensor_resonance": {"frequency_hz": 210.0, "damping": 0.1},
        "material_periodicity": {"amplitude": 0.15, "wavelength_m": 0.006},
        "drift": {"final_n": [1.0, -1.5, 1.0], "tau_s": 900.0},
        "sheet_pose": {"height_m": 3e-5, "slope": 1e-4},
        "network": {"loss": 0.01, "jitter_s": 0.002},
    },
}
"""Sets of hidden effects by name, tables as in the cell's TOML file."""

CANDIDATES = (
    "radial_runout", "unequal_pitch", "broken_tooth", "size_effect", "ploughing", "flank_wear",
    "thermal_drift", "material_periodicity", "layered_material",
)  # fmt: skip
"""Effects that tracing tries: of tool and sheet, which our simulation can carry, and drift of the sensor."""

LABELS = {"direct": "direct", "gp_only": "GP only", "effect_only": "effect", "effect_and_gp": "effect + GP"}


@dataclass(frozen=True)
class ClosedLoopConfig:
    """Settings of the experiment.

    Arguments:
        out: folder of the runs.
        results: folder of closed_loop.json and closed_loop.png.
        expert: run folder of an expert; None: trained in `out`.
        materials: sheets; hidden: names in `HIDDEN`.
        rounds, trials, cuts, candidates: as in `mjx-cutting loop`.
        size: preset of the trainings.
        seed: of everything random.
        quiet: no progress bars.
    """

    out: Path = Path("runs/closed_loop")
    results: Path = Path("experiments/results")
    expert: Path | None = None
    materials: tuple[str, ...] = ("foam", "plastic", "cardboard", "mica", "aluminium")
    hidden: tuple[str, ...] = tuple(HIDDEN)
    rounds: int = 1
    trials: int = 18
    cuts: int = 3
    candidates: tuple[str, ...] = CANDIDATES
    size: str = "cpu"
    seed: int = 0
    quiet: bool = False


PRESETS = {
    "cpu": ClosedLoopConfig(),
    "full": ClosedLoopConfig(rounds=3, trials=18, cuts=10, size="full"),
    "smoke": ClosedLoopConfig(
        materials=("plastic",),
        hidden=("runout",),
        trials=3,
        cuts=1,
        candidates=("radial_runout",),
        size="smoke",
    ),
}


def run(config: ClosedLoopConfig) -> Path:
    """Closed loop on the virtual cell, sheet by sheet and set by set of hidden effects."""
    from mjx_cutting.loop.rounds import SMOKE, RoundsConfig
    from mjx_cutting.loop.rounds import run as go_round
    from mjx_cutting.sim.config import EnvConfig

    unknown = set(config.hidden) - set(HIDDEN)
    if unknown:
        raise ValueError(f"got hidden {sorted(unknown)}; expected names of {', '.join(HIDDEN)}")
    begun = time.monotonic()
    expert = config.expert
    if expert is None:
        from mjx_cutting.learning.train import TrainConfig, train

        expert, size = config.out / "expert", config.size
        env = SMOKE if size == "smoke" else EnvConfig()
        if not (expert / "policy.npz").is_file():
            train(TrainConfig(out=expert, seed=config.seed, preset=size, env=env, quiet=config.quiet))  # type: ignore[arg-type]
    told = _earlier(config)
    for material in config.materials:
        for name in config.hidden:
            if any((each["material"], each["hidden"]) == (material, name) for each in told["cells"]):
                continue
            place = config.out / f"{material}-{name.replace(' ', '-')}"
            place.mkdir(parents=True, exist_ok=True)
            effects = place / "hidden.toml"
            write_atomic(effects, toml(HIDDEN[name]))
            started = time.monotonic()
            folder = go_round(
                RoundsConfig(
                    out=place / f"loop-{int(time.time())}",
                    material=material,
                    effects=effects,
                    expert=expert,
                    rounds=config.rounds,
                    trials=config.trials,
                    candidates=config.candidates,
                    cuts=config.cuts,
                    preset=config.size,  # type: ignore[arg-type]
                    seed=config.seed,
                    quiet=config.quiet,
                )
            )
            rounds = json.loads((folder / "rounds.json").read_text())["rounds"]
            told["cells"].append(_cell(material, name, rounds, time.monotonic() - started))
            told["wall_s"] += time.monotonic() - begun
            begun = time.monotonic()
            _write(config, told)
    _write(config, told)
    return config.results


def toml(tables: dict[str, dict[str, Any]]) -> str:
    """Tables of numbers and lists of numbers as TOML."""
    lines = []
    for name, table in tables.items():
        lines += [f"[{name}]", *(f"{key} = {json.dumps(value)}" for key, value in table.items()), ""]
    return "\n".join(lines)


def _cell(material: str, hidden: str, rounds: list[dict[str, Any]], wall_s: float) -> dict[str, Any]:
    last = rounds[-1]
    return {
        "material": material,
        "hidden": hidden,
        "heldout_nrmse_before": last["heldout_nrmse_before"],
        "heldout_nrmse_after": last["heldout_nrmse_after"],
        "named": last["named"],
        "verdict": last["verdict"],
        "reward": last["reward"],
        "rewards": last["rewards"],
        "rounds": [{k: v for k, v in each.items() if k not in ("scores", "rewards")} for each in rounds],
        "wall_s": wall_s,
    }


def _earlier(config: ClosedLoopConfig) -> dict[str, Any]:
    path = config.out / "closed_loop.json"
    if path.is_file():
        earlier: dict[str, Any] = json.loads(path.read_text())
        return earlier
    return {
        "cells": [],
        "hidden_effects": {name: HIDDEN[name] for name in config.hidden},
        "config": runs.plain(dataclasses.replace(config, out=Path("OUT"), expert=None)),
        "command": " ".join(["python -m experiments.closed_loop", *sys.argv[1:]]),
        "versions": runs.plain(runs.provenance()),
        "machine": f"{platform.machine()}, {platform.system()}",
        "wall_s": 0.0,
    }


def _write(config: ClosedLoopConfig, told: dict[str, Any]) -> None:
    text = json.dumps(runs.plain(told), indent=1, allow_nan=False) + "\n"
    config.results.mkdir(parents=True, exist_ok=True)
    for folder in (config.out, config.results):
        write_atomic(folder / "closed_loop.json", text)
    if told["cells"]:
        draw(told, config.results / "closed_loop.png")


def draw(told: dict[str, Any], path: Path) -> None:
    """Force error before and after, and each policy's gain over direct transfer, by hidden set and sheet."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    names = list(dict.fromkeys(each["hidden"] for each in told["cells"]))
    figure, axes = plt.subplots(
        2,
        len(names),
        figsize=(1.5 + 3.6 * len(names), 6.2),
        squeeze=False,
        sharey="row",
        layout="constrained",
    )
    for column, name in enumerate(names):
        cells = [each for each in told["cells"] if each["hidden"] == name]
        place = np.arange(len(cells))
        error, gain = axes[:, column]
        for shift, key, colour in ((-0.2, "before", "0.65"), (0.2, "after", "tab:blue")):
            values = [each[f"heldout_nrmse_{key}"] for each in cells]
            error.bar(place + shift, values, 0.38, color=colour, label=f"{key} tracing")
        for spot, each in zip(place, cells, strict=True):
            top = max(each["heldout_nrmse_before"], each["heldout_nrmse_after"])
            named = "\n".join(name.replace("_", " ") for name in each["named"])
            error.text(spot, top, named or "-", ha="center", va="bottom", fontsize=6)
        error.set_title(f"hidden: {name}")
        for shift, key, colour in (
            (-0.27, "gp_only", "tab:orange"), (0.0, "effect_only", "tab:blue"),
            (0.27, "effect_and_gp", "tab:green"),
        ):  # fmt: skip
            values = [each["reward"][key] - each["reward"]["direct"] for each in cells]
            gain.bar(place + shift, values, 0.25, color=colour, label=LABELS[key])
        gain.axhline(0.0, color="black", linewidth=0.8)
        for axis in (error, gain):
            axis.set_xticks(place, [each["material"] for each in cells], fontsize=8)
            axis.spines[["top", "right"]].set_visible(False)
    axes[0, 0].set_ylabel("held-out force error (NRMSE)")
    axes[1, 0].set_ylabel("reward in the cell less\nthat of direct transfer")
    axes[0, 0].legend(fontsize=8, frameon=False)
    axes[1, 0].legend(fontsize=8, frameon=False)
    figure.savefig(path, dpi=130)
    plt.close(figure)


if __name__ == "__main__":
    sys.exit(launch(run, PRESETS))
