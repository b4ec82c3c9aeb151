"""Train an expert and measure what training brought: its reward before and after, beside the fixed baseline.

    python -m experiments.expert --preset demo

writes the run of the training (expert/), and expert.json with reward, completion and the measures by sheet
of the untrained policy, the expert and the baseline, over the same episodes, with the wall-clock time of
each part.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

from experiments.launch import launch
from mjx_cutting import _files, _platform, runs
from mjx_cutting.learning import presets
from mjx_cutting.learning.settings import PPOConfig
from mjx_cutting.learning.train import TrainConfig, train
from mjx_cutting.sim.config import EnvConfig


@dataclass(frozen=True)
class Config:
    """Settings of the experiment.

    Arguments:
        ppo: settings of PPO.
        env: settings of the simulation.
        model: model.json with traced effects to act in the simulation; None: none.
        seed: of everything random.
        seeds: trainings side by side; the first is measured.
        rollouts: episodes of each policy.
        out: folder of the results; None: runs/<UTC time>-expert.
        quiet: no progress bar.
    """

    ppo: PPOConfig = field(default_factory=lambda: presets.EXPERT["cpu"])
    env: EnvConfig = field(default_factory=EnvConfig)
    model: Path | None = None
    seed: int = 0
    seeds: int = 1
    rollouts: int = 50
    out: Path | None = None
    quiet: bool = False


PRESETS = {
    name: Config(ppo=presets.EXPERT[name], rollouts=4 if name == "smoke" else 50) for name in presets.NAMES
}
PRESETS["smoke"] = dataclasses.replace(
    PRESETS["smoke"], env=EnvConfig(approach_m=0.005, cut_m=0.02, max_episode_s=4.0)
)


def run(config: Config) -> Path:
    """Train an expert and measure it."""
    out = runs.open_run(config.out, "expert", config, config.seed)
    began = time.monotonic()
    trained = train(
        TrainConfig(
            out=out / "expert",
            seed=config.seed,
            seeds=config.seeds,
            ppo=config.ppo,
            env=config.env,
            model=config.model,
            quiet=config.quiet,
        )
    )
    train_s = time.monotonic() - began
    began = time.monotonic()
    measured = measure(config, trained)
    results = {
        "command": ["python", "-m", "experiments.expert", *sys.argv[1:]],
        "versions": _platform.versions(),
        "steps": config.ppo.iterations * config.ppo.steps_per_iteration,
        "train_wall_s": round(train_s, 1),
        "evaluate_wall_s": round(time.monotonic() - began, 1),
        "strategies": measured,
    }
    _files.write_atomic(out / "expert.json", json.dumps(runs.plain(results), indent=1) + "\n")
    for name, table in measured.items():
        row = table["all"]
        print(
            f"{name:>10}: reward {row['reward']:.3f}, time {row['time_s']:.1f} s, MRV {row['mrv_mm3']:.0f} "
            f"mm^3"
        )
    return out


def measure(config: Config, trained: Path) -> dict[str, dict[str, dict[str, float]]]:
    """Return the measures by sheet of the untrained policy, the expert and the baseline."""
    from mjx_cutting.evaluation import controllers, metrics, rollouts
    from mjx_cutting.learning.checkpoint import load_policy
    from mjx_cutting.learning.environment import make_env
    from mjx_cutting.learning.expert import initial_policy
    from mjx_cutting.sim.baseline import baseline_action

    env = make_env(config.env, config.model)
    expert = load_policy(trained)
    acting = {
        "baseline": controllers.constant(baseline_action(config.env), expert),
        "untrained": controllers.direct(initial_policy(env, config.ppo, config.seed)),
        "expert": controllers.direct(expert),
    }
    rolled = rollouts.roll_out(env, acting, config.rollouts, seed=config.seed + 1000)
    return {
        name: metrics.by_material(metrics.episodes(r), config.env.materials) for name, r in rolled.items()
    }


if __name__ == "__main__":
    sys.exit(launch(run, PRESETS))
