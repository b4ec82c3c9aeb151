"""Why ours departs from the paper: one thing changed at a time, all else as in `experiments.paper`.

    python -m experiments.departures --preset cpu --expert runs/paper-cpu/expert

* **Set-points.** What our expert asks for in the mean while it cuts is asked for all the way; then some of it
  is replaced by what the paper's table implies of its own expert (soft gains, from load and deviation), or by
  the baseline's: what would it cost ours to cut as theirs did?
* **Disturbance.** Nobody has published how strong theirs was. The declared one is made stronger, the expert
  adapted to it anew by BC and DAgger, and all three are held against the clean expert: is the disturbance
  what decides whether the expert acts erratically, and who tracks it closest?
* **Episodes.** DAgger with more than one episode a round, and BC and DAgger from other seeds: how much of a
  difference between the two is chance?

Writes departures.json: reward, its terms and the measures, and the sensitivity, over the same episodes.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments import adapt
from experiments.launch import launch
from experiments.surrogate import Disturbance
from mjx_cutting import _files, _platform, runs
from mjx_cutting.evaluation import controllers, metrics, rollouts
from mjx_cutting.learning.checkpoint import load_policy
from mjx_cutting.learning.environment import make_env
from mjx_cutting.learning.policy import Policy
from mjx_cutting.learning.settings import require
from mjx_cutting.sim import action
from mjx_cutting.sim.config import EnvConfig

PAPERS_GAINS = {"stiffness_x": 360.0, "stiffness_y": 360.0, "stiffness_z": 80.0}
"""Middle of what the paper's table implies of its expert, s^-2 (286 to 459 and 61 to 98)."""
HELD: dict[str, dict[str, float]] = {
    "expert's means": {},
    "the paper's gains": PAPERS_GAINS,
    "the paper's normal gain": {"stiffness_z": 80.0},
    "highest normal gain": {"stiffness_z": 3000.0},
    "1 mm deep": {"depth": 0.001},
    "1 mm deep with the paper's gains": {"depth": 0.001, **PAPERS_GAINS},
    "nominal feed": {"feed_adjustment": 0.0},
}
"""Set-points that differ from what the expert asks for in the mean while it cuts, by name of the case."""


@dataclass(frozen=True)
class Config:
    """Settings of the experiment.

    Arguments:
        expert: run folder of a trained expert, or a policy file.
        strengths: factors on the declared disturbance.
        more_envs: episodes a round of the DAgger that gets more of them.
        seeds: seeds of BC and DAgger under the declared disturbance.
        adaptation: settings of the adaptation experiment.
        results: the results file; None: departures.json in the folder of the run.
        out: folder of the runs; None: runs/<UTC time>-departures.
    """

    expert: Path = Path("runs/paper-cpu/expert")
    strengths: tuple[float, ...] = (1.0, 2.0, 4.0)
    more_envs: int = 8
    seeds: int = 3
    adaptation: adapt.Config = dataclasses.field(default_factory=lambda: adapt.PRESETS["cpu"])
    results: Path | None = None
    out: Path | None = None

    def __post_init__(self) -> None:
        require("strengths", self.strengths, 1.0 in self.strengths, "1 among them")
        require("seeds", self.seeds, self.seeds >= 1, "at least 1")


PRESETS = {
    "cpu": Config(results=Path(__file__).resolve().parent / "results" / "departures.json"),
    "smoke": Config(strengths=(1.0,), more_envs=2, seeds=1, adaptation=adapt.SMOKE),
}


def run(config: Config) -> Path:
    """Hold set-points, strengthen the disturbance, repeat the imitation; measure."""
    out = runs.open_run(config.out, "departures", config, config.adaptation.seed)
    expert = load_policy(config.expert)
    told: dict[str, Any] = {
        "command": ["python", "-m", "experiments.departures", *sys.argv[1:]],
        "versions": _platform.versions(),
        "set_points": set_points(config, expert),
        "disturbance": {
            f"{strength:g}": under(config, expert, strength, out) for strength in config.strengths
        },
    }
    path = config.results or out / "departures.json"
    _files.write_atomic(path, json.dumps(runs.plain(told), indent=1) + "\n")
    for name, row in told["set_points"].items():
        print(f"{name:>35}: reward {row['reward']:.3f}, MRV {row['mrv_mm3']:.0f} mm^3")
    for strength, group in told["disturbance"].items():
        for name, row in group.items():
            print(f"{strength:>3} x {name:>20}: reward {row['reward']:.3f}, distance {row['distance']:.3f}")
    return out


def set_points(config: Config, expert: Policy) -> dict[str, Any]:
    """Return the measures in the source, the mean over all sheets, of the expert, and of set-points that stay
    the same all the way: what it asks for in the mean while it cuts, and each case of `HELD`."""
    given = config.adaptation
    env = make_env(given.env)
    seed = given.seed + 1000
    own = rollouts.roll_out(env, {"expert": controllers.direct(expert)}, given.rollouts, seed)["expert"]
    means = cutting_means(own, expert)
    acting = {name: held(expert, {**means, **changed}, given.env) for name, changed in HELD.items()}
    rolled = {"expert": own, **rollouts.roll_out(env, acting, given.rollouts, seed)}
    return {
        name: {**_measured(each, given.env.materials), "set_points": {**means, **HELD.get(name, {})}}
        for name, each in rolled.items()
    }


def cutting_means(rolled: rollouts.Rollouts, policy: Policy) -> dict[str, float]:
    """Return the means over time and episodes, from the first contact on, of the set-points that a policy
    asked for, by name of the action; geometric means where its range is logarithmic."""
    limits = policy.description
    touched = np.maximum.accumulate(rolled.metrics["contact_s"] > 0, axis=0) & rolled.active
    action_ = np.clip(rolled.action[touched], -1.0, 1.0).mean(axis=0)
    low, high = np.asarray(limits.action_low), np.asarray(limits.action_high)
    share = 0.5 * (action_ + 1.0)
    linear = low + share * (high - low)
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithmic = low * (high / low) ** share
    values = np.where(np.asarray(limits.action_log), logarithmic, linear)
    return dict(zip(limits.action_names, map(float, values), strict=True))


def held(like: Policy, set_points: Mapping[str, float], env: EnvConfig) -> controllers.Controller:
    """Return the controller that asks for the same set-points [by name of the action] all the way.

    Raises: ValueError for a value outside its range.
    """
    bounds = action.limits(env)
    return controllers.constant(action.to_action([set_points[name] for name in bounds.names], bounds), like)


def under(config: Config, expert: Policy, strength: float, out: Path) -> dict[str, Any]:
    """Return measures and sensitivity of the expert and of those adapted to a disturbance so strong, where it
    acts on the observation."""
    given = config.adaptation
    disturbance = _times(given.disturbance, strength)
    here = dataclasses.replace(given, expert=config.expert, gp=None, disturbance=disturbance)
    folder = out / f"{strength:g}"
    gp = adapt.disturbance_file(here, folder)

    def imitated(name: str, strategy: str, **changed: Any) -> Policy:
        settings = dataclasses.replace(here, **changed)
        return load_policy(
            adapt.stage(
                folder / name,
                lambda to, resume: adapt.adapt_expert(settings, strategy, config.expert, gp, to, resume),
            )
        )

    named = {"expert": expert}
    for seed in range(config.seeds if strength == 1.0 else 1):
        for strategy in ("bc", "dagger"):
            named[f"{strategy}, seed {seed}"] = imitated(
                f"{strategy}_{seed}", strategy, seed=given.seed + seed
            )
    more = dataclasses.replace(given.imitation, envs=config.more_envs)
    for strategy in ("bc", "dagger"):
        named[f"{strategy}, {config.more_envs} episodes"] = imitated(
            f"{strategy}_more", strategy, imitation=more
        )
    env = make_env(given.env, None, gp, "observation")
    acting = {name: controllers.direct(policy) for name, policy in named.items()}
    rolled = rollouts.roll_out(env, acting, given.rollouts, seed=given.seed + 1000)
    return {
        name: {**_measured(each, given.env.materials), **metrics.sensitivity(each, expert)}
        for name, each in rolled.items()
    }


def _times(disturbance: Disturbance, strength: float) -> Disturbance:
    def scaled(std_n: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = (strength * each for each in std_n)
        return x, y, z

    return dataclasses.replace(
        disturbance, std_n=scaled(disturbance.std_n), trial_std_n=scaled(disturbance.trial_std_n)
    )


def _measured(rolled: rollouts.Rollouts, materials: tuple[str, ...]) -> dict[str, Any]:
    """Means over all sheets, and the least reward with the sheet it came from."""
    measures = metrics.episodes(rolled)
    worst = int(np.argmin(measures["reward"]))
    return {
        **metrics.by_material(measures, materials)["all"],
        "reward_min": float(measures["reward"][worst]),
        "reward_min_episode": worst,
        "reward_min_sheet": materials[int(measures["material"][worst])],
        "reward_tenth": float(np.quantile(measures["reward"], 0.1)),
    }


if __name__ == "__main__":
    sys.exit(launch(run, PRESETS))
