"""Search for settings of PPO: many side by side on each device, many processes on one study.

    python -m experiments.sweep --preset cpu --out runs/sweep --member 0 &
    python -m experiments.sweep --preset cpu --out runs/sweep --member 1 &

Every process asks the study for `width` proposals, trains them with all seeds in one computation
(`learning.sweep`), and tells the rewards; the study is a journal file in the folder, which processes on one
machine or one file system share (Optuna; needs the extra `sweep`). The search ends when the study has
`trials` results. Writes sweep.json: the best settings and every trial.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from experiments.launch import launch
from mjx_cutting import _files, runs
from mjx_cutting.learning import presets
from mjx_cutting.learning.settings import PPOConfig, require
from mjx_cutting.sim.config import EnvConfig

RANGES: dict[str, tuple[float, float, bool]] = {
    "learning_rate": (1e-4, 3e-3, True),
    "entropy_cost": (1e-6, 1e-2, True),
    "discount": (0.98, 0.9995, False),
    "gae_lambda": (0.85, 1.0, False),
    "clip": (0.1, 0.4, False),
    "value_cost": (0.1, 2.0, True),
    "reward_scaling": (1.0, 100.0, True),
    "max_grad_norm": (0.2, 10.0, True),
    "initial_std": (0.1, 1.0, True),
    "noise_scale_final": (0.1, 1.0, True),
}
"""What is searched by default range: low, high, and whether evenly in the logarithm."""
JOURNAL = "study.journal"


@dataclass(frozen=True)
class Config:
    """Settings of the search.

    Arguments:
        searched: names out of `RANGES`.
        trials: results after which every process stops.
        width: proposals trained side by side.
        seeds: trainings of each proposal; the result is their mean.
        member: number of this process, so that each proposes others.
        ppo: settings that the proposals change.
        env: settings of the simulation.
        seed: of everything random.
        out: folder of the study, shared by the processes; None: runs/<UTC time>-sweep.
    """

    searched: tuple[str, ...] = ("learning_rate", "entropy_cost", "discount", "clip")
    trials: int = 32
    width: int = 4
    seeds: int = 1
    member: int = 0
    ppo: PPOConfig = field(default_factory=lambda: presets.EXPERT["demo"])
    env: EnvConfig = field(default_factory=EnvConfig)
    seed: int = 0
    out: Path | None = None

    def __post_init__(self) -> None:
        for name in ("trials", "width", "seeds"):
            require(name, getattr(self, name), getattr(self, name) >= 1, "at least 1")
        unknown = sorted(set(self.searched) - set(RANGES))
        require(
            "searched",
            self.searched,
            bool(self.searched) and not unknown,
            f"names out of {', '.join(RANGES)}",
        )


PRESETS = {
    "smoke": Config(
        searched=("learning_rate", "discount"),
        trials=2,
        width=2,
        ppo=presets.EXPERT["smoke"],
        env=EnvConfig(approach_m=0.005, cut_m=0.01, max_episode_s=0.5),
    ),
    "cpu": Config(),
    "full": Config(trials=256, width=16, seeds=3, ppo=dataclasses.replace(presets.EXPERT["demo"], envs=256)),
}
Rewards = Callable[[Sequence[Mapping[str, float]]], np.ndarray]


def run(config: Config) -> Path:
    """Search for settings of PPO, alone or beside other processes on the same study."""
    from mjx_cutting.learning.environment import make_env
    from mjx_cutting.learning.sweep import train_all

    out = runs.open_run(config.out, "sweep", config, config.seed)
    env = make_env(config.env)
    study = search(
        config, out, lambda proposals: train_all(env, config.ppo, proposals, config.seeds, config.seed)
    )
    told = summary(study)
    _files.write_atomic(out / "sweep.json", json.dumps(runs.plain(told), indent=1) + "\n")
    print(
        f"best of {len(told['trials'])}: reward {told['best']['reward']:.3f} with {told['best']['settings']}"
    )
    return out


def search(config: Config, out: Path, rewards: Rewards) -> Any:
    """Ask and tell until the study in `out` has its trials; return the study.

    Arguments:
        config: settings.
        out: folder of the journal.
        rewards: proposals -> [proposals, seeds]; NaN where a training failed.

    Raises: ValueError without Optuna.
    """
    optuna = _optuna()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    backend = optuna.storages.journal.JournalFileBackend(str(out / JOURNAL))
    study = optuna.create_study(
        study_name="ppo",
        storage=optuna.storages.JournalStorage(backend),
        sampler=optuna.samplers.TPESampler(seed=1000 * config.seed + config.member, constant_liar=True),
        direction="maximize",
        load_if_exists=True,
    )
    while _finished(study) < config.trials:
        asked = [study.ask() for _ in range(config.width)]
        proposals = [
            {
                name: trial.suggest_float(name, *RANGES[name][:2], log=RANGES[name][2])
                for name in config.searched
            }
            for trial in asked
        ]
        for trial, values in zip(asked, rewards(proposals), strict=True):
            mean = float(np.mean(values))
            failed = optuna.trial.TrialState.FAIL
            study.tell(trial, mean if np.isfinite(mean) else None, None if np.isfinite(mean) else failed)
    return study


def summary(study: Any) -> dict[str, Any]:
    """Return the best settings and every trial, in the order in which they were proposed.

    Raises: ValueError where no training came to a reward.
    """
    trials = [{"settings": t.params, "reward": t.value, "state": t.state.name.lower()} for t in study.trials]
    told = [trial for trial in trials if trial["reward"] is not None]
    if not told:
        raise ValueError(
            "got no training with a reward; expected at least one in which an episode ended; give more "
            "--ppo.steps"
        )
    return {"best": max(told, key=lambda trial: trial["reward"]), "trials": trials}


def _finished(study: Any) -> int:
    return sum(trial.state.is_finished() for trial in study.get_trials(deepcopy=False))


def _optuna() -> Any:
    try:
        import optuna
        import optuna.storages.journal
    except ImportError as error:
        raise ValueError(
            "got no package optuna; expected it installed; pip install 'mjx-cutting[sweep]'"
        ) from error
    return optuna


if __name__ == "__main__":
    sys.exit(launch(run, PRESETS))
