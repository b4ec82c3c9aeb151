"""Adapt an expert to a disturbance by each strategy and compare them on the same episodes, in both domains.

    python -m experiments.adapt --preset smoke

Without --expert an expert is trained first; without --gp the declared disturbance of
`experiments.surrogate` is fitted. Writes the runs of all trainings, and in evaluation/ the tables and
figures of `mjx-cutting evaluate`. Stages that are complete in the folder given by --out are not run again,
and one that was interrupted goes on from its checkpoint, so an experiment stopped by Ctrl-C is continued
by the same command.
"""

from __future__ import annotations

import dataclasses
import functools
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from experiments.launch import launch
from experiments.surrogate import Disturbance, fit_declared
from mjx_cutting import _files, runs
from mjx_cutting.evaluation.evaluate import EvaluateConfig, evaluate
from mjx_cutting.learning import checkpoint, presets
from mjx_cutting.learning.adapt import STRATEGIES, AdaptConfig, adapt
from mjx_cutting.learning.settings import ImitationConfig, PPOConfig
from mjx_cutting.learning.train import TrainConfig, train
from mjx_cutting.sim.config import EnvConfig

DONE = "done"


@dataclass(frozen=True)
class Config:
    """Settings of the experiment.

    Arguments:
        strategies: which to adapt by.
        expert: run folder of a trained expert; None: train one.
        gp: disturbance of `mjx-cutting fit-gp`; None: fit the declared one.
        model: model.json with traced effects; None: none.
        disturbance: the declared one.
        expert_ppo, re_train, fine_tune: settings of PPO.
        refine: settings of PPO with which a traced effect is learnt (`experiments.traced`).
        imitation: settings of bc and dagger.
        env: settings of the simulation.
        seed: of everything random.
        seeds: experts side by side, and re-trained policies; the first of each is adapted and evaluated.
        rollouts: episodes of each strategy in each domain.
        out: folder of the results; None: runs/<UTC time>-adaptation.
        quiet: no progress bars.
    """

    strategies: tuple[str, ...] = STRATEGIES
    expert: Path | None = None
    gp: Path | None = None
    model: Path | None = None
    disturbance: Disturbance = field(default_factory=Disturbance)
    expert_ppo: PPOConfig = field(default_factory=lambda: presets.EXPERT["cpu"])
    re_train: PPOConfig = field(default_factory=lambda: presets.EXPERT["cpu"])
    fine_tune: PPOConfig = field(default_factory=lambda: presets.FINE_TUNE["cpu"])
    refine: PPOConfig = field(default_factory=lambda: presets.REFINE["cpu"])
    imitation: ImitationConfig = field(default_factory=lambda: presets.IMITATION["cpu"])
    env: EnvConfig = field(default_factory=EnvConfig)
    seed: int = 0
    seeds: int = 1
    rollouts: int = 50
    out: Path | None = None
    quiet: bool = False


def preset(name: str) -> Config:
    """Return the settings of a preset of `learning.presets`."""
    return Config(
        expert_ppo=presets.EXPERT[name],
        re_train=presets.EXPERT[name],
        fine_tune=presets.FINE_TUNE[name],
        refine=presets.REFINE[name],
        imitation=presets.IMITATION[name],
    )


SMOKE = dataclasses.replace(
    preset("smoke"),
    disturbance=Disturbance(trials=3, duration_s=2.0, rate_hz=100.0),
    env=EnvConfig(approach_m=0.005, cut_m=0.02, max_episode_s=4.0),
    rollouts=4,
)
PRESETS = {"smoke": SMOKE, "demo": preset("demo"), "cpu": preset("cpu"), "full": preset("full")}


def run(config: Config) -> Path:
    """Train, adapt by each strategy, and compare."""
    out = runs.open_run(config.out, "adaptation", config, config.seed)
    folders = adapt_all(config, out)
    evaluate(
        EvaluateConfig(
            policies=tuple(folders.values()),
            names=tuple(folders),
            domain="both",
            gp=disturbance_file(config, out),
            model=config.model,
            rollouts=config.rollouts,
            low_pass=True,
            seed=config.seed + 1000,
            env=config.env,
            out=out / "evaluation",
        )
    )
    return out


def adapt_all(config: Config, out: Path) -> dict[str, Path]:
    """Return the run folders by strategy, the expert's first; what is complete already is left as it is."""
    gp = disturbance_file(config, out)
    expert = config.expert or stage(out / "expert", functools.partial(train_expert, config))
    folders = {"expert": expert}
    for strategy in config.strategies:
        folders[strategy] = stage(
            out / strategy, functools.partial(adapt_expert, config, strategy, expert, gp)
        )
    return folders


def adapt_expert(
    config: Config, strategy: Any, expert: Path, gp: Path | None, folder: Path, resume: Path | None
) -> Path:
    """Adapt an expert by one strategy into a folder, to a disturbance, the effects of a model, or both."""
    return adapt(
        AdaptConfig(
            expert=expert,
            strategy=strategy,
            gp=gp,
            model=config.model,
            out=folder,
            seed=config.seed,
            seeds=config.seeds if strategy == "re_train" else 1,
            imitation=config.imitation,
            ppo=config.fine_tune if strategy == "fine_tune" else config.re_train,
            env=config.env,
            resume=resume,
            quiet=config.quiet,
        )
    )


def train_expert(config: Config, folder: Path, resume: Path | None) -> Path:
    """Train the expert of the experiment into a folder."""
    return train(
        TrainConfig(
            out=folder,
            seed=config.seed,
            seeds=config.seeds,
            ppo=config.expert_ppo,
            env=config.env,
            model=config.model,
            resume=resume,
            quiet=config.quiet,
        )
    )


def stage(folder: Path, work: Callable[[Path, Path | None], Path]) -> Path:
    """Run one part of an experiment, unless it is complete, going on from its checkpoint where it has one."""
    if not (folder / DONE).exists():
        begun = checkpoint.checkpoints(folder)
        work(folder, folder if begun else None)
        _files.write_atomic(folder / DONE, "")
    return folder


def disturbance_file(config: Config, out: Path) -> Path:
    """Return the disturbance of the experiment, fitted where none was given."""
    path = config.gp or out / "gp.npz"
    return path if path.exists() else fit_declared(config.disturbance, path)


if __name__ == "__main__":
    sys.exit(launch(run, PRESETS))
