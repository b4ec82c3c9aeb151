"""The fixed baseline (nominal feed, 1 mm, the start's gains), and its rows beside the paper's.

    python -m mjx_cutting.sim.baseline [--episodes N] [--seed N] [--json FILE]

prints time, path deviation, load and removed volume per sheet, each beside the paper's figure.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mjx_cutting import _files, runs
from mjx_cutting.sim import action as actions
from mjx_cutting.sim.config import EnvConfig
from mjx_cutting.sim.env import METRICS, CuttingEnv
from mjx_cutting.sim.materials import PAPER_BASELINE


class Row(NamedTuple):
    """Means over the episodes on one sheet, with the spread between episodes.

    Fields: `time_s`; `deviation_mm` and `load_n`, means over the time in contact; `mrv_mm3` removed volume;
    `reward`; `completed` share; `mrv_low_mm3`, `mrv_high_mm3` 10 and 90 % quantiles; `episodes`.
    """

    time_s: float
    deviation_mm: float
    load_n: float
    mrv_mm3: float
    reward: float
    completed: float
    mrv_low_mm3: float
    mrv_high_mm3: float
    episodes: int


def baseline_action(config: EnvConfig) -> np.ndarray:
    """[5] the action that holds the baseline's set-points."""
    physical = [*config.start_stiffness_s2, 0.0, config.baseline_depth_m]
    return actions.to_action(physical, actions.limits(config)).astype(np.float32)


class BaselinePolicy:
    """A policy that ignores its observation."""

    def __init__(self, config: EnvConfig):
        self._action = jnp.asarray(baseline_action(config))

    def __call__(self, obs: Array) -> Array:
        """[..., 5] the baseline's action for observations [..., 15]."""
        return jnp.broadcast_to(self._action, (*obs.shape[:-1], actions.SIZE))


def baseline_rows(config: EnvConfig | None = None, episodes: int = 64, seed: int = 0) -> dict[str, Row]:
    """The baseline's row for each sheet of `config`, over `episodes` draws of constants a sheet."""
    config = config or EnvConfig()
    rows = {}
    for name in config.materials:
        sums = run_episodes(replace(config, materials=(name,)), episodes, seed)
        contact = np.maximum(sums["contact_s"], 1e-9)
        low, high = np.quantile(sums["mrv_mm3"], [0.1, 0.9])
        rows[name] = Row(
            time_s=float(np.mean(sums["steps"]) * config.policy_step_s),
            deviation_mm=float(np.mean(sums["contact_error_mm_s"] / contact)),
            load_n=float(np.mean(sums["contact_load_n_s"] / contact)),
            mrv_mm3=float(np.mean(sums["mrv_mm3"])),
            reward=float(np.mean(sums["reward"])),
            completed=float(np.mean(sums["completed"])),
            mrv_low_mm3=float(low),
            mrv_high_mm3=float(high),
            episodes=episodes,
        )
    return rows


def run_episodes(config: EnvConfig, episodes: int, seed: int) -> dict[str, np.ndarray]:
    """Sums over each of `episodes` baseline episodes, by name, [episodes]."""
    env = CuttingEnv(config)
    action = jnp.broadcast_to(jnp.asarray(baseline_action(config)), (episodes, env.action_size))
    step = jax.vmap(env.step)

    @jax.jit
    def run(keys: Array) -> dict[str, Array]:
        state = jax.vmap(env.reset)(keys)
        names = ("reward", "steps", *METRICS)
        kept = {name: jnp.zeros(episodes) for name in names}

        def one(carry: tuple, _: None) -> tuple[tuple, None]:
            state, kept, ended = carry
            state = step(state, action)
            sums = state.info["episode_sums"]
            kept = {name: jnp.where(ended, kept[name], sums[name]) for name in names}
            return (state, kept, ended | (state.done > 0.0)), None

        nominal = round(1.1 * config.path_m / (config.nominal_feed_m_s * config.policy_step_s))
        length = min(nominal, config.max_episode_steps)
        start = (state, kept, jnp.zeros(episodes, bool))
        return jax.lax.scan(one, start, None, length=length)[0][1]

    return {name: np.asarray(v) for name, v in run(jax.random.split(jax.random.key(seed), episodes)).items()}


def table(rows: dict[str, Row]) -> str:
    """The rows as a markdown table, the paper's figure in brackets."""
    lines = [
        "| sheet | time s | deviation mm | load N | MRV mm^3 | MRV 10-90 % | reward |",
        "|-|-|-|-|-|-|-|",
    ]
    for name, row in rows.items():
        paper = PAPER_BASELINE.get(name)
        cells = []
        for value, form, index in (
            (row.time_s, ".1f", 0), (row.deviation_mm, ".2f", 1),
            (row.load_n, ".2f", 2), (row.mrv_mm3, ".1f", 3),
        ):  # fmt: skip
            cells.append(f"{value:{form}}" + (f" ({paper[index]:g})" if paper else ""))
        spread = f"{row.mrv_low_mm3:.1f}-{row.mrv_high_mm3:.1f}"
        lines.append(f"| {name} | {' | '.join(cells)} | {spread} | {row.reward:.2f} |")
    return "\n".join(lines)


def comparison(rows: dict[str, Row], seed: int) -> dict[str, Any]:
    """The rows, the paper's and ours over the paper's, ready for JSON, with what they came from."""
    names = ("time_s", "deviation_mm", "load_n", "mrv_mm3")
    found: dict[str, Any] = {
        "what": "fixed baseline (nominal feed, 1 mm), means over episodes; deviation and load over contact",
        "paper": "Hathaway, Stolkin, Rastegarpanah, IROS 2024, real robot, mean of 5 trials",
        "seed": seed,
        "provenance": runs.provenance(),
        "sheets": {},
    }
    for name, row in rows.items():
        ours = row._asdict()
        paper = dict(zip(names, PAPER_BASELINE.get(name, ()), strict=False))
        ratio = {key: ours[key] / value for key, value in paper.items()}
        found["sheets"][name] = {"ours": ours, "paper": paper, "ours_over_paper": ratio}
    return found


def main() -> None:
    """Parse the command line, play, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--episodes", type=int, default=64, help="draws of constants a sheet")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    given = parser.parse_args()
    rows = baseline_rows(episodes=given.episodes, seed=given.seed)
    print(table(rows))
    if given.json:
        told = comparison(rows, given.seed)
        _files.write_atomic(given.json, json.dumps(told, indent=2) + "\n")


if __name__ == "__main__":
    main()
