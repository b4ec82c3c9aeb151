"""How long the expert takes to learn, beside stable-baselines3's PPO, in one run on this machine.

    python benchmarks/learning_speed.py [--quick] [--json FILE] [--steps N] [--peer-steps N] [--most-s S]

Ours is PPO in the batched simulation as `mjx-cutting train` runs it; the peer is stable-baselines3 on the
Gymnasium-style C MuJoCo environment of the simulation benchmark, a process a core (needs the extra `peers`).
Both have the same networks, discount and spread of the first actions, and settings of their own otherwise.
One trains after the other. A curve is the mean return of the last 50 episodes that ended in training, against
the wall-clock time since the start, compilation and the start of processes included.

Both are asked for the same reward: from where they began (the mean of both) 95 % of the way to the lower of
the two final rewards; a ladder of rewards up to the better final one says when each got how far. The
throughput, in policy steps a second, is told apart. At the end both policies act without noise on the peer's
environment, the same episodes, so that it shows whether they learned the same.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mjx_cutting import _files, _platform
from mjx_cutting.sim import throughput
from mjx_cutting.sim.config import EnvConfig

WINDOW = 50
SHARE = 0.95
LADDER = (0.2, 0.4, 0.6, 0.8, SHARE)


def main() -> int:
    """Parse the command line, measure, print; returns the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="a few episodes of a short path: does it run")
    parser.add_argument("--json", type=Path, help="write all figures to this file")
    parser.add_argument("--steps", type=int, default=1_000_000, help="policy steps of ours")
    parser.add_argument("--peer-steps", type=int, default=1_000_000, help="policy steps of the peer")
    parser.add_argument("--most-s", type=float, default=3600.0, help="the peer is stopped after this, s")
    parser.add_argument("--processes", type=int, default=os.cpu_count(), help="environments of the peer")
    parser.add_argument("--episodes", type=int, default=20, help="of the comparison at the end")
    given = parser.parse_args()
    task = EnvConfig()
    if given.quick:
        given.steps, given.peer_steps, given.episodes = 40_960, 4_000, 2
        task = EnvConfig(approach_m=0.005, cut_m=0.02, max_episode_s=4.0)
    try:
        import learning_peer
    except ImportError as error:
        print(
            f"error: got no {error.name}; expected the packages of the extra `peers`; "
            "pip install 'mjx-cutting[peers]'",
            file=sys.stderr,
        )
        return 2
    result = measure(given, task, learning_peer)
    print(table(result))
    if given.json:
        _files.write_atomic(given.json, json.dumps(result, indent=1) + "\n")
    return 0


def measure(given: argparse.Namespace, task: EnvConfig, peer: Any) -> dict[str, Any]:
    """Both trainings and what they came to, ready for JSON."""
    config = _config(given.steps)
    ours, ours_told, ours_policy = train_ours(task, config)
    print(f"ours: {ours_told['steps']:,} steps in {ours_told['wall_s']:.0f} s", flush=True)
    theirs, theirs_told, theirs_policy = peer.train(
        task,
        given.peer_steps,
        given.processes,
        config.hidden,
        config.discount,
        config.initial_std,
        given.most_s,
    )
    print(f"peer: {theirs_told['steps']:,} steps in {theirs_told['wall_s']:.0f} s", flush=True)
    curves = {"ours": smoothed(ours), "stable_baselines3": smoothed(theirs)}
    told = {"ours": ours_told, "stable_baselines3": theirs_told}
    acting = {"ours": ours_policy, "stable_baselines3": theirs_policy}
    began = float(np.mean([curve["reward"][0] for curve in curves.values()]))
    target = began + SHARE * (min(curve["reward"][-1] for curve in curves.values()) - began)
    result: dict[str, Any] = {
        "command": ["python", "benchmarks/learning_speed.py", *sys.argv[1:]],
        "versions": _platform.versions(),
        "machine": throughput.machine(),
        "network": {"hidden": list(config.hidden), "value_hidden": list(config.value_hidden)},
        "peer_settings": {**peer.SETTINGS, "processes": given.processes},
        "began_reward": began,
        "target_reward": target,
    }
    for name, curve in curves.items():
        own = curve["reward"][0] + SHARE * (curve["reward"][-1] - curve["reward"][0])
        result[name] = {
            **told[name],
            "final_reward": curve["reward"][-1],
            "to_target": reached(curve, target),
            "to_own_95_percent": reached(curve, own),
            "reward_on_the_peers_environment": peer.evaluate(task, acting[name], given.episodes),
            "curve": {key: _thinned(values) for key, values in curve.items()},
        }
    mine, other = (result[name]["to_target"] for name in curves)
    result["ladder"] = ladder(curves, began)
    both = mine is not None and other is not None
    result["wall_clock_ratio"] = other["wall_s"] / mine["wall_s"] if both else None
    result["steps_ratio"] = other["steps"] / mine["steps"] if both else None
    result["throughput_ratio"] = ours_told["steps_per_s"] / theirs_told["steps_per_s"]
    return result


def train_ours(task: EnvConfig, config: Any) -> tuple[list[tuple[float, int, float]], dict[str, float], Any]:
    """Ours, in the form of the peer's `train`; an iteration's episodes share time and mean return."""
    from mjx_cutting.deploy.export import build
    from mjx_cutting.deploy.runtime import PolicyRuntime
    from mjx_cutting.learning.environment import make_env
    from mjx_cutting.learning.expert import train_policy
    from mjx_cutting.learning.progress import METRICS, read_lines

    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        env = make_env(task)
        (policy,) = train_policy(env, config, Path(folder) / "run", quiet=True, checkpoint_every_s=1e9)
        wall_s = time.perf_counter() - began
        lines = read_lines(Path(folder) / "run" / METRICS)
    # What the loop did not time (making and compiling the start, the last checkpoint) comes first.
    before = wall_s - lines[-1]["wall_s"]
    episodes = [
        (before + line["wall_s"], int(line["steps"]), float(line["episode_return"]))
        for line in lines
        for _ in range(int(line["episodes"]))
    ]
    runtime, scales = PolicyRuntime(build(policy)), np.asarray(env.observation_scales)
    told = {
        "wall_s": wall_s,
        "steps": lines[-1]["steps"],
        "steps_per_s": lines[-1]["steps"] / wall_s,
        "steps_per_s_compiled": float(np.median([line["steps_per_s"] for line in lines])),
    }
    return episodes, told, lambda observation: runtime(observation * scales)


def smoothed(episodes: Sequence[tuple[float, int, float]]) -> dict[str, list[float]]:
    """The curve over episodes: wall_s, steps, and reward, the mean of the last `WINDOW` episodes.

    Raises: ValueError when fewer than two episodes ended.
    """
    if len(episodes) < 2:
        raise ValueError(f"got {len(episodes)} episodes; expected two or more; give more steps")
    returns = np.asarray([each[2] for each in episodes])
    total = np.concatenate([[0.0], np.cumsum(returns)])
    width = min(WINDOW, len(returns) // 2)
    ends = np.arange(width, len(returns) + 1)
    return {
        "wall_s": [episodes[end - 1][0] for end in ends],
        "steps": [episodes[end - 1][1] for end in ends],
        "reward": [float(value) for value in (total[ends] - total[ends - width]) / width],
    }


def reached(curve: dict[str, list[float]], reward: float) -> dict[str, float] | None:
    """Time, s, and steps at which a curve first is at a reward; None where it never is."""
    there = np.flatnonzero(np.asarray(curve["reward"]) >= reward)
    if not there.size:
        return None
    return {"wall_s": curve["wall_s"][there[0]], "steps": curve["steps"][there[0]]}


def ladder(curves: dict[str, dict[str, list[float]]], began: float) -> list[dict[str, Any]]:
    """Rewards from `began` up to the better of the final ones, and when each curve was there, by name; None
    where it never was."""
    best = max(curve["reward"][-1] for curve in curves.values())
    rewards = [began + share * (best - began) for share in LADDER]
    return [
        {"reward": reward, **{name: reached(curve, reward) for name, curve in curves.items()}}
        for reward in rewards
    ]


def table(result: dict[str, Any]) -> str:
    """The comparison as a markdown table."""
    lines = [
        f"reward asked of both: {result['target_reward']:.3f} (they began at {result['began_reward']:.3f})",
        "| | policy steps/s | s to it | steps to it | final reward | on the peer's environment |",
        "|-|-|-|-|-|-|",
    ]
    for name in ("ours", "stable_baselines3"):
        row = result[name]
        to = row["to_target"]
        there = f"{to['wall_s']:.0f} | {to['steps']:,}" if to else "not reached | -"
        lines.append(
            f"| {name.replace('_', ' ')} | {row['steps_per_s']:,.0f} | {there} | {row['final_reward']:.3f} | "
            f"{row['reward_on_the_peers_environment']:.3f} |"
        )
    for name in ("wall_clock_ratio", "steps_ratio", "throughput_ratio"):
        value = result[name]
        lines.append(f"{name.replace('_', ' ')}: {'-' if value is None else f'{value:.1f}'}")
    lines += ["| reward | ours, s | stable baselines3, s |", "|-|-|-|"]
    for rung in result["ladder"]:
        times = [
            f"{there['wall_s']:.0f}" if (there := rung[name]) else f"not in {result[name]['wall_s']:.0f}"
            for name in ("ours", "stable_baselines3")
        ]
        lines.append(f"| {rung['reward']:.3f} | {' | '.join(times)} |")
    return "\n".join(lines)


def _config(steps: int) -> Any:
    """Ours: the expert's settings on a CPU, with value networks of the same size as the policy's."""
    import dataclasses

    from mjx_cutting.learning import presets

    return dataclasses.replace(presets.EXPERT["cpu"], steps=steps, value_hidden=presets.EXPERT["cpu"].hidden)


def _thinned(values: list[float], most: int = 200) -> list[float]:
    """At most so many entries, evenly spaced, the last among them."""
    places = np.unique(np.linspace(0, len(values) - 1, min(most, len(values))).round().astype(int))
    return [values[i] for i in places]


if __name__ == "__main__":
    sys.exit(main())
