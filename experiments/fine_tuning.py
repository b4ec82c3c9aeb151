"""What fine-tuning costs where there is nothing to learn: the expert goes on in the domain it was trained in.

    python -m experiments.fine_tuning --preset cpu --expert runs/paper-cpu/expert

There is no disturbance, so a method that does what it should leaves the expert as good as it was. Each
variant changes one setting of the paper's (50 episodes, a learning rate of 1e-3, batches of 64): the learning
rate, the passes over each batch, the spread of the actions; "refine" is what the loop uses. Writes
fine_tuning.json: reward and measures by sheet over the same episodes, acting without noise, for the expert
and each variant.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from experiments.launch import launch
from mjx_cutting import _files, _platform, runs
from mjx_cutting.learning import presets
from mjx_cutting.learning.settings import PPOConfig
from mjx_cutting.sim.config import EnvConfig

VARIANTS: dict[str, dict[str, Any]] = {
    "paper": {},
    "learning rate 3e-4": {"learning_rate": 3e-4},
    "learning rate 1e-4": {"learning_rate": 1e-4},
    "one pass": {"epochs": 1},
    "whole spread": {"noise_scale": 1.0, "noise_scale_final": 1.0},
    "refine": vars(presets.REFINE["cpu"]),
    "refine at 3e-4": {**vars(presets.REFINE["cpu"]), "learning_rate": 3e-4, "learning_rate_final": 1e-4},
}
"""Settings that differ from the preset's, by name."""


@dataclass(frozen=True)
class Config:
    """Settings of the experiment.

    Arguments:
        expert: run folder of a trained expert, or a policy file.
        variants: names in `VARIANTS`.
        ppo: settings of fine-tuning that the variants start from.
        env: settings of the simulation.
        seeds: fine-tunings side by side of each variant; all are measured.
        seed: of everything random.
        rollouts: episodes of each policy.
        results: the results file; None: fine_tuning.json in the folder of the run.
        out: folder of the runs; None: runs/<UTC time>-fine-tuning.
        quiet: no progress bars.
    """

    expert: Path = Path("runs/paper-cpu/expert")
    variants: tuple[str, ...] = tuple(VARIANTS)
    ppo: PPOConfig = field(default_factory=lambda: presets.FINE_TUNE["cpu"])
    env: EnvConfig = field(default_factory=EnvConfig)
    seeds: int = 3
    seed: int = 0
    rollouts: int = 50
    results: Path | None = None
    out: Path | None = None
    quiet: bool = False


PRESETS = {
    "cpu": Config(results=Path(__file__).resolve().parent / "results" / "fine_tuning.json"),
    "smoke": Config(
        variants=("paper",),
        ppo=presets.FINE_TUNE["smoke"],
        env=EnvConfig(approach_m=0.005, cut_m=0.02, max_episode_s=4.0),
        seeds=1,
        rollouts=4,
    ),
}


def run(config: Config) -> Path:
    """Fine-tune by every variant and measure."""
    from mjx_cutting.evaluation import controllers, metrics, rollouts
    from mjx_cutting.learning.checkpoint import load_policy
    from mjx_cutting.learning.environment import make_env
    from mjx_cutting.learning.expert import sized_like, train_policy

    unknown = set(config.variants) - set(VARIANTS)
    if unknown:
        raise ValueError(f"got variants {sorted(unknown)}; expected names of {', '.join(VARIANTS)}")
    out = runs.open_run(config.out, "fine-tuning", config, config.seed)
    expert, env = load_policy(config.expert), make_env(config.env)
    acting = {"expert": controllers.direct(expert)}
    for name in config.variants:
        policies = train_policy(
            env,
            sized_like(dataclasses.replace(config.ppo, **VARIANTS[name]), expert),
            out / name.replace(" ", "_"),
            seed=config.seed,
            seeds=config.seeds,
            start=expert,
            strategy="fine_tune",
            quiet=config.quiet,
        )
        acting |= {f"{name}, seed {i}": controllers.direct(each) for i, each in enumerate(policies)}
    rolled = rollouts.roll_out(env, acting, config.rollouts, seed=config.seed + 1000)
    told = {
        "command": ["python", "-m", "experiments.fine_tuning", *sys.argv[1:]],
        "versions": _platform.versions(),
        "ppo": runs.plain(config.ppo),
        "variants": {name: VARIANTS[name] for name in config.variants},
        "policies": {
            name: metrics.by_material(metrics.episodes(each), config.env.materials)
            for name, each in rolled.items()
        },
    }
    path = config.results or out / "fine_tuning.json"
    _files.write_atomic(path, json.dumps(runs.plain(told), indent=1) + "\n")
    for name, table in told["policies"].items():
        row = table["all"]
        print(f"{name:>30}: reward {row['reward']:.3f}, MRV {row['mrv_mm3']:.0f} mm^3")
    return out


if __name__ == "__main__":
    sys.exit(launch(run, PRESETS))
