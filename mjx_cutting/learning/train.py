"""What `mjx-cutting train` does: an expert by PPO, in a run folder, resumable."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from mjx_cutting import runs
from mjx_cutting.learning import presets
from mjx_cutting.learning.settings import PPOConfig, require
from mjx_cutting.sim.config import EnvConfig

METRICS = "metrics.jsonl"


@dataclass(frozen=True)
class TrainConfig:
    """Settings of `mjx-cutting train`.

    Arguments:
        out: run folder; None: runs/<UTC time>-train.
        seed: of everything random; with several seeds the first.
        seeds: trainings side by side.
        steps: policy steps; None: as the preset says.
        preset: "smoke", "demo", "cpu" or "full"; sizes of the training.
        ppo: settings of PPO; None: the preset's.
        env: settings of the simulation.
        model: model.json of `mjx-cutting trace`, whose effects act in the simulation; None: none.
        gp: disturbance of `mjx-cutting fit-gp` to train under; None: none.
        resume: run folder (or one of its checkpoints) to go on with; its settings are used, `steps` may be
            raised.
        distributed: share the environments with the other processes of the cluster, all started with this
            option and the same `out` on a file system they share.
        checkpoint_every_s: least wall-clock time between checkpoints, s.
        tensorboard: write TensorBoard scalars too (needs tensorboardX).
        quiet: no progress bar.
    """

    out: Path | None = None
    seed: int = 0
    seeds: int = 1
    steps: int | None = None
    preset: Literal["smoke", "demo", "cpu", "full"] = "cpu"
    ppo: PPOConfig | None = None
    env: EnvConfig = field(default_factory=EnvConfig)
    model: Path | None = None
    gp: Path | None = None
    resume: Path | None = None
    distributed: bool = False
    checkpoint_every_s: float = 60.0
    tensorboard: bool = False
    quiet: bool = False

    def __post_init__(self) -> None:
        presets.check(self.preset)
        require("seeds", self.seeds, self.seeds >= 1, "at least 1")
        require("steps", self.steps, self.steps is None or self.steps >= 1, "at least 1")
        require("checkpoint_every_s", self.checkpoint_every_s, self.checkpoint_every_s >= 0, "0 or more")
        if self.distributed and self.out is None and self.resume is None:
            raise ValueError(
                "got distributed=True without a run folder; expected one that all processes share; give --out"
            )


def train(config: TrainConfig) -> Path:
    """Train an expert and return its run folder, which holds policy.npz, metrics.jsonl, config.json and
    checkpoints.

    Raises: ValueError for settings or files that cannot be used; `loop.TrainingInterrupted` after Ctrl-C (its
        `exit_code` is 130), with a whole checkpoint; `loop.TrainingDiverged`; OSError when nothing can be
        written.
    """
    from mjx_cutting.learning.distributed import Alone, join
    from mjx_cutting.learning.environment import make_env
    from mjx_cutting.learning.expert import train_policy

    config = resolve(config)
    shards = join() if config.distributed else Alone()
    env = make_env(config.env, config.model, config.gp)
    run = open_run(config, "train", shards.leader)
    assert config.ppo is not None
    train_policy(
        env,
        config.ppo,
        run,
        seed=config.seed,
        seeds=config.seeds,
        settings=shared(config),
        # Without a schedule the number of steps decides only where the run ends.
        may_differ=() if config.ppo.has_schedule else ("ppo.steps",),
        resume=config.resume,
        checkpoint_every_s=config.checkpoint_every_s,
        quiet=config.quiet,
        tensorboard=config.tensorboard,
        shards=shards,
    )
    return run


def resolve(config: TrainConfig) -> TrainConfig:
    """Return the settings with preset and steps worked in; of a run to resume, with that run's settings."""
    if config.resume is not None:
        stored = stored_config(config.resume)
        env, ppo = from_stored(EnvConfig, stored["env"]), from_stored(PPOConfig, stored["ppo"])
        config = dataclasses.replace(
            config,
            out=config.out or run_of(config.resume),
            seed=stored["seed"],
            seeds=stored["seeds"],
            preset=stored["preset"],
            env=env,
            ppo=ppo,
            model=as_path(stored["model"]),
            gp=as_path(stored["gp"]),
        )
    ppo = config.ppo or presets.EXPERT[config.preset]
    if config.steps is not None:
        ppo = dataclasses.replace(ppo, steps=config.steps)
    return dataclasses.replace(config, ppo=ppo, steps=ppo.steps)


def shared(config: Any) -> dict[str, Any]:
    """Return the settings that a resumed run must share: all that decide what is computed."""
    apart = ("out", "resume", "distributed", "quiet", "tensorboard", "checkpoint_every_s", "steps", "preset")
    return {k: v for k, v in runs.plain(config).items() if k not in apart}


def open_run(config: Any, verb: str, leader: bool = True) -> Path:
    """Return the run folder, with config.json and versions.json written; for a resumed run its own.

    Of several processes the `leader` alone writes them.

    Raises: ValueError when the folder holds a run that is not being resumed.
    """
    out = config.out
    resumed = config.resume is not None and run_of(config.resume).resolve() == Path(out).resolve()
    if not resumed and out is not None and (Path(out) / METRICS).exists():
        raise ValueError(
            f"got out={out}, which holds a run already; expected a new folder; give another --out, or go on "
            f"with "
            f"--resume {out}"
        )
    return runs.open_run(out, verb, config, config.seed) if leader else Path(out)


def run_of(resume: Path) -> Path:
    """Return the run folder of a run folder or of one of its checkpoints."""
    resume = Path(resume)
    return resume.parent.parent if resume.parent.name == "checkpoints" else resume


def stored_config(run: Path) -> Mapping[str, Any]:
    """Return the settings in a run's config.json.

    Raises: ValueError when there are none or they are not whole.
    """
    path = run_of(run) / "config.json"
    try:
        return json.loads(path.read_text())["config"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValueError(
            f"got {run} without readable settings ({path}: {error}); expected a run folder of mjx-cutting; "
            "give the folder that the run was started with"
        ) from error


def from_stored(kind: Any, stored: Mapping[str, Any]) -> Any:
    """Return a settings dataclass from config.json: lists become tuples."""
    return kind(**{k: _tuples(v) for k, v in stored.items()})


def as_path(value: str | None) -> Path | None:
    """Return a path from config.json's text."""
    return None if value is None else Path(value)


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value
