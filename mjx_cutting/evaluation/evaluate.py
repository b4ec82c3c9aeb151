"""What `mjx-cutting evaluate` does: policies and the fixed baseline, in the source and the surrogate domain.

    OUT/evaluation.json   by domain and strategy: measures by sheet, sensitivity, Welch tests of the reward
    OUT/episodes.csv      every rollout
    OUT/reward.png, terms_<domain>.png, over_time_<domain>.png

The domain "source" is the simulation without a disturbance, "surrogate" with one. Every strategy faces the
same episodes in both. A domain outside the simulation, as the virtual cell is, is handed in by who calls:
this room knows the controllers and what comes back, not what serves them.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import itertools
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mjx_cutting import _files, runs
from mjx_cutting.evaluation import controllers, figures, metrics, rollouts, statistics
from mjx_cutting.learning.checkpoint import load_policy
from mjx_cutting.learning.environment import make_env
from mjx_cutting.learning.settings import require
from mjx_cutting.learning.train import as_path, from_stored, stored_config
from mjx_cutting.sim.baseline import baseline_action
from mjx_cutting.sim.config import EnvConfig

Domain = Callable[[EnvConfig, Mapping[str, controllers.Controller]], dict[str, rollouts.Rollouts]]
"""A domain outside the simulation: settings of the simulation and controllers by name to their rollouts."""

DOMAINS = {
    "source": ("source",),
    "surrogate": ("surrogate",),
    "both": ("source", "surrogate"),
    "cell": ("cell",),
    "all": ("source", "surrogate", "cell"),
}


@dataclass(frozen=True)
class EvaluateConfig:
    """Settings of `mjx-cutting evaluate`.

    Arguments:
        policies: run folders (or policy files); the first is the reference of sensitivity, usually the
            expert.
        names: of the strategies, one a policy; default: from each policy's provenance.
        domain: "source", "surrogate" (needs gp), "both" of them, "cell" (the virtual cell), or "all" three.
        gp: disturbance of `mjx-cutting fit-gp`.
        model: model.json of `mjx-cutting trace`, whose effects act; None: that of the first policy's run.
        disturbance_mode: how the disturbance acts: "observation" or "dynamics".
        rollouts: episodes of each strategy in each simulated domain.
        cuts: of each strategy in the cell, where a cut takes seconds; the sheets take turns.
        effects: TOML file with the cell's hidden effects; None: those that `mjx_cutting.loop.cell_domain`
            declares.
        baseline: evaluate the fixed baseline too.
        low_pass: evaluate the first policy behind a Butterworth filter (order 10, 5 Hz) on the force too.
        seed: decides the episodes.
        env: settings of the simulation; None: those of the first policy's run.
        out: run folder; None: runs/<UTC time>-evaluate.
    """

    policies: tuple[Path, ...]
    names: tuple[str, ...] = ()
    domain: Literal["source", "surrogate", "both", "cell", "all"] = "source"
    gp: Path | None = None
    model: Path | None = None
    disturbance_mode: Literal["observation", "dynamics"] = "observation"
    rollouts: int = 50
    cuts: int = 10
    effects: Path | None = None
    baseline: bool = True
    low_pass: bool = False
    seed: int = 0
    env: EnvConfig | None = None
    out: Path | None = None

    def __post_init__(self) -> None:
        require("policies", self.policies, len(self.policies) >= 1, "at least one run folder")
        require("rollouts", self.rollouts, self.rollouts >= 2, "at least 2")
        require("cuts", self.cuts, self.cuts >= 2, "at least 2")
        require("domain", self.domain, self.domain in DOMAINS, f"one of {', '.join(DOMAINS)}")
        if self.names and len(self.names) != len(self.policies):
            raise ValueError(
                f"got {len(self.names)} names for {len(self.policies)} policies; expected one each"
            )
        if "surrogate" in self.domains and self.gp is None:
            raise ValueError(
                f"got domain={self.domain} without a disturbance; expected one; give --gp gp.npz "
                "(from `mjx-cutting fit-gp`), or --domain source"
            )

    @property
    def domains(self) -> tuple[str, ...]:
        """The single domains that `domain` stands for."""
        return DOMAINS[self.domain]


def evaluate(config: EvaluateConfig, cell: Domain | None = None) -> Path:
    """Evaluate policies and return the run folder with evaluation.json, episodes.csv and figures.

    Arguments:
        config: settings.
        cell: the virtual cell as a domain (`mjx_cutting.loop.cell_domain`), where `config` asks for it.

    Raises: ValueError for settings or files that cannot be used; OSError when nothing can be written.
    """
    config = _resolve(config)
    assert config.env is not None
    named = dict(zip(_names(config), map(load_policy, config.policies), strict=True))
    results = run_domains(config, named, cell)
    run = runs.open_run(config.out, "evaluate", config, config.seed)
    materials = config.env.materials
    write_results(run, results, named, materials)
    return run


def run_domains(
    config: EvaluateConfig, named: Mapping[str, Any], cell: Domain | None = None
) -> dict[str, dict[str, rollouts.Rollouts]]:
    """Return the rollouts by domain and strategy.

    Where the disturbance acts on the observation only, both simulated domains run in one environment, in
    which the strategies see clean observations for the source domain: one compilation less.
    """
    assert config.env is not None
    if "cell" in config.domains and cell is None:
        raise ValueError(
            f"got domain={config.domain} without a cell; expected one; hand in "
            "mjx_cutting.loop.cell_domain.cell_domain(), as `mjx-cutting evaluate` does"
        )
    first = next(iter(named.values()))
    acting = {}
    if config.baseline:
        acting["baseline"] = controllers.constant(baseline_action(config.env), first)
    acting |= {name: controllers.direct(policy) for name, policy in named.items()}
    if config.low_pass:
        names = first.description.observation_names
        force = [i for i, name in enumerate(names) if name.startswith("force")]
        acting["low_pass"] = controllers.low_passed(first, force)
    controllers.comparable(list(acting.values()))
    simulated = [domain for domain in config.domains if domain != "cell"]
    results: dict[str, dict[str, rollouts.Rollouts]] = {}
    if simulated and config.gp is not None and config.disturbance_mode == "observation":
        env = make_env(config.env, config.model, config.gp, config.disturbance_mode)
        seeing = {
            f"{domain}/{name}": dataclasses.replace(c, clean=np.asarray(domain == "source"))
            for domain in simulated
            for name, c in acting.items()
        }
        found = rollouts.roll_out(env, seeing, config.rollouts, config.seed)
        results = {domain: {name: found[f"{domain}/{name}"] for name in acting} for domain in simulated}
    else:
        for domain in simulated:
            gp = config.gp if domain == "surrogate" else None
            env = make_env(config.env, config.model, gp, config.disturbance_mode)
            results[domain] = rollouts.roll_out(env, acting, config.rollouts, config.seed)
    if "cell" in config.domains and cell is not None:
        results["cell"] = cell(config.env, acting)
    return results


def summarise(
    results: Mapping[str, Mapping[str, rollouts.Rollouts]],
    named: Mapping[str, Any],
    materials: tuple[str, ...],
) -> dict[str, Any]:
    """Return what evaluation.json holds: by domain, measures, sensitivity and set-points by strategy, and the
    Welch tests.
    """
    expert = next(iter(named.values()))
    summary: dict[str, Any] = {}
    for domain, group in results.items():
        measures = {name: metrics.episodes(r) for name, r in group.items()}
        tests = {
            f"{a} - {b}": dataclasses.asdict(statistics.welch(measures[a]["reward"], measures[b]["reward"]))
            for a, b in itertools.combinations(measures, 2)
        }
        summary[domain] = {
            "strategies": {
                name: {
                    "reward_min": float(measures[name]["reward"].min()),
                    "reward_std": float(measures[name]["reward"].std(ddof=1)),
                    "by_material": metrics.by_material(measures[name], materials),
                    "sensitivity": metrics.sensitivity(r, expert),
                    "set_points": metrics.set_points(r, expert.description),
                }
                for name, r in group.items()
            },
            "welch_reward": tests,
        }
    return summary


def write_results(
    run: Path,
    results: Mapping[str, Mapping[str, rollouts.Rollouts]],
    named: Mapping[str, Any],
    materials: tuple[str, ...],
) -> dict[str, Any]:
    """Write tables and figures of rollouts by domain and strategy into a run folder, and return the
    summary.
    """
    summary = summarise(results, named, materials)
    description = next(iter(named.values())).description
    _files.write_atomic(run / "evaluation.json", json.dumps(runs.plain(summary), indent=1) + "\n")
    _files.write_atomic(run / "episodes.csv", _csv(results, materials))
    rewards = {d: {name: r.total("reward") for name, r in group.items()} for d, group in results.items()}
    figures.save(figures.violins(rewards), run / "reward.png")
    for domain, group in results.items():
        tables = {name: s["by_material"] for name, s in summary[domain]["strategies"].items()}
        figures.save(figures.reward_terms(tables, materials, f"{domain} domain"), run / f"terms_{domain}.png")
        moving = {name: r for name, r in group.items() if name != "baseline"}
        disturbed = domain != "source"
        figures.save(
            figures.over_time(moving or group, description, disturbed), run / f"over_time_{domain}.png"
        )
    return summary


def _csv(results: Mapping[str, Mapping[str, rollouts.Rollouts]], materials: tuple[str, ...]) -> str:
    text = io.StringIO()
    writer = None
    for domain, group in results.items():
        for name, r in group.items():
            measures = metrics.episodes(r)
            for i in range(len(r.material)):
                row = {"domain": domain, "strategy": name, "rollout": i}
                row |= {k: f"{v[i]:.6g}" for k, v in measures.items()}
                row["material"] = materials[int(r.material[i])]
                writer = writer or csv.DictWriter(text, list(row), lineterminator="\n")
                if text.tell() == 0:
                    writer.writeheader()
                writer.writerow(row)
    return text.getvalue()


def _resolve(config: EvaluateConfig) -> EvaluateConfig:
    env, model = config.env, config.model
    first = Path(config.policies[0])
    if first.is_dir():
        stored = stored_config(first)
        env = env or from_stored(EnvConfig, stored["env"])
        model = model or as_path(stored["model"])
    env = dataclasses.replace(env or EnvConfig(), disturbance_mode="none")
    return dataclasses.replace(config, env=env, model=model)


def _names(config: EvaluateConfig) -> tuple[str, ...]:
    if config.names:
        return config.names
    names: list[str] = []
    for path in config.policies:
        name = json.loads(load_policy(path).provenance).get("strategy", "policy")
        names.append(name if name not in names else f"{name}_{sum(n.startswith(name) for n in names) + 1}")
    return tuple(names)
