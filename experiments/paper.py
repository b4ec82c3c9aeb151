"""The paper's experiment: train the expert, adapt it every way, compare, and judge each headline.

    python -m experiments.paper --preset cpu

Everything that `experiments.adapt` does, with several seeds of the expert and of the re-trained policy for
the training curves, and beyond the paper the adaptations of `experiments.traced`. Evaluated in four domains:
the source, the surrogate with the disturbance on the observation, the same in dynamics and reward, and the
virtual cell, where a cut takes seconds, so that there are few (`cuts`). Then
experiments/results/paper_<preset>.json: wall-clock of all commands so far, versions, the strategies'
summaries by domain, the Welch tests, and for each headline of the paper whether it was reproduced; and the
figures of `experiments.paper_figures` beside it. The same command goes on where it was stopped.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments import adapt, headlines, paper_figures, traced
from experiments.invocations import Invocations
from experiments.judging import MOVING
from experiments.launch import launch
from mjx_cutting import _files, _platform, runs
from mjx_cutting.evaluation.evaluate import EvaluateConfig, run_domains, write_results
from mjx_cutting.learning.checkpoint import load_policy
from mjx_cutting.learning.progress import METRICS, read_lines
from mjx_cutting.loop.cell_domain import DECLARED, cell_domain

RESULTS = Path(__file__).resolve().parent / "results"


@dataclass(frozen=True)
class Config(adapt.Config):
    """Settings of the experiment: those of `experiments.adapt`, and where the results file goes.

    Arguments:
        results: the results file; None: paper.json in the folder of the run.
        cuts: of each strategy in the virtual cell, at least 2; the sheets take turns.
        effects: TOML file with the cell's hidden effects; None: those that `loop.cell_domain` declares.
        beyond: adapt with the traced effect too, with a GP alone, and with both.
    """

    results: Path | None = None
    cuts: int = 10
    effects: Path | None = None
    beyond: bool = True


def preset(name: str, base: adapt.Config, seeds: int, results: Path | None, **fields: Any) -> Config:
    """Return the settings of a preset from those of the adaptation experiment."""
    given = {f.name: getattr(base, f.name) for f in dataclasses.fields(base)}
    out = None if name == "smoke" else Path("runs") / f"paper-{name}"
    return Config(**{**given, "seeds": seeds, "out": out}, results=results, **fields)


PRESETS = {
    "smoke": preset("smoke", adapt.PRESETS["smoke"], 2, None, cuts=2, beyond=False),
    "cpu": preset("cpu", adapt.PRESETS["cpu"], 3, RESULTS / "paper_cpu.json"),
    "full": preset("full", adapt.PRESETS["full"], 5, RESULTS / "paper_full.json", cuts=50),
}


def run(config: Config) -> Path:
    """Run the whole experiment."""
    out = runs.open_run(config.out, "paper", config, config.seed)
    with Invocations(out, lambda: sum(trained_s(out).values())) as spent:
        told = experiment(config, out, spent)
    for name, headline in told["headlines"].items():
        print(f"{headline['judgement']:>15}: {name}: {headline['paper']}")
    return out


def experiment(config: Config, out: Path, spent: Invocations) -> dict[str, Any]:
    """Train, adapt, evaluate and write the results, and return what the results file holds."""
    folders = adapt.adapt_all(config, out)
    found: dict[str, Any] = {}
    if config.beyond:
        more, found = traced.adapt_traced(config, out, folders["expert"], config.effects)
        folders |= more
    policies = {name: load_policy(folder) for name, folder in folders.items()}
    rolled = roll_out(config, out, folders, policies)
    summary = write_results(out, rolled, policies, config.env.materials)
    curves = {str(name): curve(folders[name]) for name in ("expert", "re_train") if name in folders}
    path = config.results or out / "paper.json"
    description = policies["expert"].description
    drawn = paper_figures.draw(path, summary, rolled, curves, description, config.env.materials)
    told = {
        "wall_s": spent.wall_s,
        "invocations": spent.all,
        "command": ["python", "-m", "experiments.paper", *sys.argv[1:]],
        "versions": _platform.versions(),
        "config": runs.plain(dataclasses.replace(config, out=None, results=None)),
        "expert_learned": learned(folders["expert"]),
        "training_wall_s": {name: wall_s(folder) for name, folder in folders.items()},
        "episodes": {"simulated": config.rollouts, "cell": config.cuts},
        "cell_effects": str(config.effects) if config.effects else DECLARED,
        "traced": found,
        "strategies": strategies(summary),
        "welch_reward": {domain: s["welch_reward"] for domain, s in summary.items()},
        "headlines": headlines.judged(summary, curves),
        "figures": [each.name for each in drawn],
    }
    _files.write_atomic(path, json.dumps(rounded(runs.plain(told)), indent=1) + "\n")
    return told


def roll_out(
    config: Config, out: Path, folders: dict[str, Path], policies: dict[str, Any]
) -> dict[str, dict[str, Any]]:
    """Return the rollouts by domain and strategy: source, surrogate, surrogate_dynamics, cell."""
    evaluation = EvaluateConfig(
        policies=tuple(folders.values()),
        names=tuple(folders),
        domain="both",
        gp=adapt.disturbance_file(config, out),
        model=config.model,
        rollouts=config.rollouts,
        cuts=config.cuts,
        low_pass=True,
        seed=config.seed + 1000,
        env=config.env,
    )

    def told(line: str) -> None:
        if not config.quiet:
            print(line, file=sys.stderr)

    rolled = run_domains(evaluation, policies)
    moving = dataclasses.replace(evaluation, domain="surrogate", disturbance_mode="dynamics")
    rolled[MOVING] = run_domains(moving, policies)["surrogate"]
    cell = cell_domain(config.effects, config.cuts, evaluation.seed, told)
    in_cell = dataclasses.replace(evaluation, domain="cell")
    return {**rolled, **run_domains(in_cell, policies, cell)}


def rounded(value: Any) -> Any:
    """Return JSON values with six significant digits: more says nothing of a few dozen episodes."""
    if isinstance(value, dict):
        return {key: rounded(each) for key, each in value.items()}
    if isinstance(value, list):
        return [rounded(each) for each in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


def strategies(summary: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the summaries by strategy, then domain, under the names of the results file."""
    renamed = {"fine_tune": "fine_tuned", "re_train": "re_trained"}  # gp_only and the like stay
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


def learned(folder: Path, share: float = 0.95, width: int = 20) -> dict[str, float] | None:
    """Return when a training had made a share of its gain in reward: policy steps of one seed and seconds.

    The reward is the mean over seeds and over the last `width` iterations in which episodes ended for all;
    None where there was no such iteration.
    """
    lines = read_lines(folder / METRICS)
    steps, rewards = curve(folder)
    told = np.flatnonzero(np.isfinite(rewards).all(axis=1))
    if not len(told):
        return None
    mean = rewards[told].mean(axis=1)
    width = min(width, len(mean))
    smooth = np.convolve(mean, np.ones(width) / width, "valid")
    first = int(np.argmax(smooth >= smooth[0] + share * (smooth[-1] - smooth[0])))
    at = told[first + width - 1]
    return {"steps": float(steps[at]), "wall_s": float(lines[at]["wall_s"]), "reward": float(smooth[first])}


def wall_s(folder: Path) -> float:
    """Return the wall-clock time that a training took, s, its compilation included."""
    return float(read_lines(folder / METRICS)[-1]["wall_s"])


def trained_s(out: Path) -> dict[str, float]:
    """Return the wall-clock time of each training begun in an experiment's folder, s."""
    return {path.parent.name: wall_s(path.parent) for path in out.glob(f"*/{METRICS}")}


if __name__ == "__main__":
    sys.exit(launch(run, PRESETS))
