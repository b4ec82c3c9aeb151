"""A cut in the virtual cell in the simulation's terms: the same path and saw, the same reward."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjx_cutting.deploy.virtual_cell import CellConfig
from mjx_cutting.sim.config import EnvConfig


def cell_config(env: EnvConfig, material: str, seed: int) -> CellConfig:
    """The cell with the path, the sheet's place and the saw of a simulation.

    Raises:
        ValueError: the cell has no such sheet, or cannot hold the path or the saw.
    """
    return CellConfig(
        material=material,
        start_m=env.start_m,
        surface_m=env.surface_height_m,
        approach_m=env.approach_m,
        cut_m=env.cut_m,
        teeth=env.teeth,
        diameter_m=env.diameter_m,
        kerf_m=env.kerf_m,
        spindle_rev_s=env.spindle_speed_rev_s,
        seed=seed,
    )


def reward_terms(env: EnvConfig, score: dict[str, Any]) -> dict[str, float]:
    """The terms of the simulation's reward of one cut, from the cell's amounts.

    Arguments: `env` has the weights; `score` as `virtual_cell.score.Score.to_dict`.
    """
    failed = score["why"] not in ("", "finished")
    return {
        "reward_mrv": env.reward_mrv_per_mm3 * score["mrv_mm3"],
        "reward_time": -env.reward_time_per_s * score["time_s"],
        "reward_path": -float(np.dot(env.reward_path_per_mm2_s, score["error_squared_mm2_s"])),
        "reward_force": -float(np.dot(env.reward_force_per_n2_s, score["force_squared_n2_s"])),
        "reward_failure": env.failure_reward if failed else 0.0,
    }


def reward(env: EnvConfig, score: dict[str, Any]) -> float:
    """The simulation's reward of one cut in the cell: the sum of `reward_terms`."""
    return sum(reward_terms(env, score).values())
