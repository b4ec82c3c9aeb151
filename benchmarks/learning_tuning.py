"""Settings for stable-baselines3's PPO on the cutting task, by random search; see `learning_peer.SETTINGS`.

    python benchmarks/learning_tuning.py [--trials N] [--each-s S] [--json FILE]

Every trial trains for the same wall-clock time on this machine, as in the comparison of `learning_speed.py`,
and counts by the mean return of the last episodes that ended. The first trial is what stands in SETTINGS now.
Networks, discount and the spread of the first actions are those of the comparison. Needs the extra `peers`.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

import learning_peer
import numpy as np

from mjx_cutting import _files, _platform
from mjx_cutting.learning import presets
from mjx_cutting.sim import throughput
from mjx_cutting.sim.config import EnvConfig

LAST = 30
SPACE: dict[str, tuple[Any, ...]] = {
    "learning_rate": (3e-4, 6e-4, 1e-3, 2e-3),
    "n_steps": (256, 512, 1024, 2048),
    "batch_size": (64, 128, 256, 512),
    "n_epochs": (5, 10),
    "ent_coef": (0.0, 1e-4, 1e-3),
}


def main() -> None:
    """Parse the command line, search, print the trials, best first."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trials", type=int, default=8)
    parser.add_argument("--each-s", type=float, default=110.0, help="wall-clock time of a trial, s")
    parser.add_argument("--seed", type=int, default=0, help="of the settings tried")
    parser.add_argument("--json", type=Path, help="write all trials to this file, after each of them")
    given = parser.parse_args()
    config, rng = presets.EXPERT["cpu"], np.random.default_rng(given.seed)
    trials: list[dict[str, Any]] = []
    for index in range(given.trials):
        tried = {name: choices[rng.integers(len(choices))] for name, choices in SPACE.items()}
        settings = {**learning_peer.SETTINGS, **(tried if index else {})}
        episodes, trained, _ = learning_peer.train(
            EnvConfig(),
            10_000_000,
            os.cpu_count() or 1,
            config.hidden,
            config.discount,
            config.initial_std,
            given.each_s,
            settings,
        )
        if not episodes:
            raise ValueError(
                f"got no episode that ended in {given.each_s:g} s; expected {LAST} or more; "
                "give a longer --each-s"
            )
        score = float(np.mean([each[2] for each in episodes[-LAST:]]))
        row = {"return": score, "steps": trained["steps"], **{name: settings[name] for name in SPACE}}
        print(json.dumps(row), flush=True)
        trials.append(row)
        trials.sort(key=lambda each: -each["return"])
        if given.json:
            told = {
                "command": ["python", "benchmarks/learning_tuning.py", *sys.argv[1:]],
                "versions": _platform.versions(),
                "machine": throughput.machine(),
                "trials": trials,
            }
            _files.write_atomic(given.json, json.dumps(told, indent=1) + "\n")
    print(f"best: {json.dumps(trials[0])}")


if __name__ == "__main__":
    main()
