"""What `mjx-cutting adapt` does: an expert becomes a policy for the disturbed domain, by one of four
strategies.

| strategy | learner starts as | learns from | in |
|-|-|-|-|
| bc | expert | the expert's clean actions, expert acting | observations corrected |
| dagger | expert | the same, learner acting more and more | observations corrected |
| fine_tune | expert | reward (PPO) | disturbance in dynamics and reward |
| re_train | nothing | reward (PPO) | disturbance in dynamics and reward |
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from mjx_cutting.learning import presets
from mjx_cutting.learning.settings import ImitationConfig, PPOConfig, require
from mjx_cutting.learning.train import as_path, from_stored, open_run, run_of, shared, stored_config
from mjx_cutting.sim.config import EnvConfig

STRATEGIES = ("bc", "dagger", "fine_tune", "re_train")


@dataclass(frozen=True)
class AdaptConfig:
    """Settings of `mjx-cutting adapt`.

    Arguments:
        expert: run folder of `mjx-cutting train`, or a policy file.
        strategy: "bc", "dagger", "fine_tune" or "re_train".
        gp: disturbance of `mjx-cutting fit-gp`; None only with a model, to adapt to its effects alone.
        model: model.json of `mjx-cutting trace`, whose effects act in the simulation; None: the expert's.
        out: run folder; None: runs/<UTC time>-adapt.
        seed: of everything random; with several seeds the first.
        seeds: trainings side by side, for fine_tune and re_train.
        preset: "smoke", "demo", "cpu" or "full"; sizes of the training.
        disturbance_mode: "observation" or "dynamics"; None: the strategy's own (see above).
        imitation: settings of bc and dagger; None: the preset's.
        ppo: settings of fine_tune and re_train; None: the preset's.
        env: settings of the simulation; None: the expert's.
        resume: run folder (or one of its checkpoints) to go on with; its settings are used.
        checkpoint_every_s: least wall-clock time between checkpoints, s.
        tensorboard: write TensorBoard scalars too (needs tensorboardX).
        quiet: no progress bar.
    """

    expert: Path
    strategy: Literal["bc", "dagger", "fine_tune", "re_train"] = "dagger"
    gp: Path | None = None
    model: Path | None = None
    out: Path | None = None
    seed: int = 0
    seeds: int = 1
    preset: Literal["smoke", "demo", "cpu", "full"] = "cpu"
    disturbance_mode: Literal["observation", "dynamics"] | None = None
    imitation: ImitationConfig | None = None
    ppo: PPOConfig | None = None
    env: EnvConfig | None = None
    resume: Path | None = None
    checkpoint_every_s: float = 60.0
    tensorboard: bool = False
    quiet: bool = False

    def __post_init__(self) -> None:
        presets.check(self.preset)
        require("strategy", self.strategy, self.strategy in STRATEGIES, f"one of {STRATEGIES}")
        require("seeds", self.seeds, self.seeds >= 1, "at least 1")
        require("checkpoint_every_s", self.checkpoint_every_s, self.checkpoint_every_s >= 0, "0 or more")
        if self.gp is None and self.model is None and self.resume is None:
            raise ValueError(
                "got neither gp nor model; expected a disturbance or a traced effect to adapt to; give --gp "
                "gp.npz "
                "(from `mjx-cutting fit-gp`), --model model.json (from `mjx-cutting trace`), or both"
            )


def adapt(config: AdaptConfig) -> Path:
    """Adapt an expert and return the run folder, which holds policy.npz, metrics.jsonl, config.json,
    checkpoints.

    Raises: ValueError for settings or files that cannot be used; `loop.TrainingInterrupted` after Ctrl-C (its
        `exit_code` is 130), with a whole checkpoint; `loop.TrainingDiverged`; OSError when nothing can be
        written.
    """
    from mjx_cutting.learning.checkpoint import load_policy
    from mjx_cutting.learning.environment import make_env
    from mjx_cutting.learning.expert import sized_like, train_policy
    from mjx_cutting.learning.imitation.training import imitate

    config = resolve(config)
    assert config.env is not None and config.disturbance_mode is not None
    expert = load_policy(config.expert)
    env = make_env(config.env, config.model, config.gp, config.disturbance_mode)
    run = open_run(config, "adapt")
    if config.imitation is not None:
        imitate(
            env,
            expert,
            config.imitation,
            run,
            strategy=config.strategy,
            seed=config.seed,
            settings=shared(config),
            resume=config.resume,
            checkpoint_every_s=config.checkpoint_every_s,
            quiet=config.quiet,
            tensorboard=config.tensorboard,
        )
        return run
    assert config.ppo is not None
    train_policy(
        env,
        sized_like(config.ppo, expert),
        run,
        seed=config.seed,
        seeds=config.seeds,
        start=expert if config.strategy == "fine_tune" else None,
        strategy=config.strategy,
        settings=shared(config),
        resume=config.resume,
        checkpoint_every_s=config.checkpoint_every_s,
        quiet=config.quiet,
        tensorboard=config.tensorboard,
    )
    return run


def resolve(config: AdaptConfig) -> AdaptConfig:
    """Return the settings with preset, strategy and the expert's simulation worked in."""
    if config.resume is not None:
        stored = stored_config(config.resume)
        imitation, ppo = stored["imitation"], stored["ppo"]
        return dataclasses.replace(
            config,
            out=config.out or run_of(config.resume),
            expert=Path(stored["expert"]),
            strategy=stored["strategy"],
            gp=as_path(stored["gp"]),
            model=as_path(stored["model"]),
            seed=stored["seed"],
            seeds=stored["seeds"],
            preset=stored["preset"],
            disturbance_mode=stored["disturbance_mode"],
            imitation=None if imitation is None else from_stored(ImitationConfig, imitation),
            ppo=None if ppo is None else from_stored(PPOConfig, ppo),
            env=from_stored(EnvConfig, stored["env"]),
        )
    imitates = config.strategy in ("bc", "dagger")
    sizes = presets.FINE_TUNE if config.strategy == "fine_tune" else presets.EXPERT
    env, model = config.env, config.model
    if Path(config.expert).is_dir():
        stored = stored_config(config.expert)
        env = env or from_stored(EnvConfig, stored["env"])
        model = model or as_path(stored["model"])
    return dataclasses.replace(
        config,
        env=env or EnvConfig(),
        model=model,
        disturbance_mode=config.disturbance_mode or ("observation" if imitates else "dynamics"),
        imitation=(config.imitation or presets.IMITATION[config.preset]) if imitates else None,
        ppo=None if imitates else (config.ppo or sizes[config.preset]),
    )
