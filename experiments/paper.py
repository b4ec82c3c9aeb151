"""The paper's experiment: train the expert, adapt it every way, compare, and judge each headline.

    python -m experiments.paper --preset cpu

Everything that `experiments.adapt` does, with several seeds of the expert and of the re-trained policy for
the training curves, and then experiments/results/paper_<preset>.json: wall-clock, command, versions, the
strategies' summaries in both domains, the Welch tests, and for each headline of the paper whether it was
reproduced. The same command goes on where it was stopped.

What the paper measured on its robot is not compared here: the surrogate domain is the simulation with the
declared (or a fitted) disturbance in dynamics and reward.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments import adapt, headlines
from experiments.launch import launch
from mjx_cutting import _files, _platform, runs
from mjx_cutting.evaluation import figures
from mjx_cutting.evaluation.evaluate import EvaluateConfig, run_domains, write_results
from mjx_cutting.learning.checkpoint import load_policy
from mjx_cutting.learning.progress import METRICS, read_lines

RESULTS = Path(__file__).resolve().parent / "results"


@dataclass(frozen=True)
class Config(adapt.Config):
    """Settings of the experiment: those of `experiments.adapt`, and where the results file goes.

    Arguments:
        results: the results file; None: paper.json in the folder of the run.
    """

    results: Path | None = None


def preset(name: str, base: adapt.Config, seeds: int, results: Path | None) -> Config:
    """Return the settings of a preset from those of the adaptation experiment."""
    fields = {f.name: getattr(base, f.name) for f in dataclasses.fields(base)}
    out = None if name == "smoke" else Path("runs") / f"paper-{name}"
    return Config(**{**fields, "seeds": seeds, "out": out}, results=results)


PRESETS = {
    "smoke": preset("smoke", adapt.PRESETS["smoke"], 2, None),
    "cpu": preset("cpu", adapt.PRESETS["cpu"], 3, RESULTS / "paper_cpu.json"),
    "full": preset("full", adapt.PRESETS["full"], 5, RESULTS / "paper_full.json"),
}


def run(config: Config) -> Path:
    """Run the whole experiment."""
    began = time.monotonic()
    out = runs.open_run(config.out, "paper", config, config.seed)
    folders = adapt.adapt_all(config, out)
    evaluation = EvaluateConfig(
        policies=tuple(folders.values()),
        names=tuple(folders),
        domain="both",
        gp=adapt.disturbance_file(config, out),
        model=config.model,
        rollouts=config.rollouts,
        low_pass=True,
        seed=config.seed + 1000,
        env=config.env,
    )
    policies = {name: load_policy(folder) for name, folder in folders.items()}
    rolled = run_domains(evaluation, policies)
    moving = dataclasses.replace(evaluation, domain="surrogate", disturbance_mode="dynamics")
    rolled[headlines.MOVING] = run_domains(moving, policies)["surrogate"]
    summary = write_results(out, rolled, policies, config.env.materials)
    curves = {str(name): curve(folders[name]) for name in ("expert", "re_train") if name in folders}
    figures.save(figures.training_curves(curves, smooth=20), out / "training.png")
    results = {
        "wall_s": round(time.monotonic() - began, 1),
        "command": ["python", "-m", "experiments.paper", *sys.argv[1:]],
        "versions": _platform.versions(),
        "config": runs.plain(config),
        "training_wall_s": {name: wall_s(folder) for name, folder in folders.items()},
        "strategies": strategies(summary),
        "welch_reward": {domain: s["welch_reward"] for domain, s in summary.items()},
        "headlines": headlines.judged(summary),
    }
    _files.write_atomic(
        config.results or out / "paper.json", json.dumps(runs.plain(results), indent=1) + "\n"
    )
    for name, headline in results["headlines"].items():
        print(f"{headline['judgement']:>15}: {name}: {headline['paper']}")
    return out


def strategies(summary: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the summaries by strategy, then domain, under the names of the results file."""
    renamed = {"fine_tune": "fine_tuned", "re_train": "re_trained"}
    found: dict[str, dict[str, Any]] = {}
    for domain, told in summary.items():
        for name, values in told["strategies"].items():
            found.setdefault(renamed.get(name, name), {})[domain] = values
    return found


def curve(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the policy steps of one seed [T] and the episode reward [T, seeds] of a training, NaN where
    none ended.
    """
    lines = read_lines(folder / METRICS)
    ended = np.asarray([np.atleast_1d(line["episodes"]) for line in lines], float)
    reward = np.asarray([np.atleast_1d(line["episode_return"]) for line in lines], float)
    steps = np.asarray([line["steps"] for line in lines], float) / reward.shape[1]
    return steps, np.where(ended > 0, reward, np.nan)


def wall_s(folder: Path) -> float:
    """Return the wall-clock time that a training took, s, its compilation included."""
    return float(read_lines(folder / METRICS)[-1]["wall_s"])


if __name__ == "__main__":
    sys.exit(launch(run, PRESETS))
