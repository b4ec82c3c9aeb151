"""The virtual cell as a domain of the evaluation, beside the simulation with and without a disturbance.

Every controller is exported as it would be for a robot and served to the cell in lock step: other physics
code, a robot with friction, packets between, and effects that no training has seen. Cut i has the same
sheet, noise and spindle angle for every controller; the sheets go round in the order of the simulation's
materials, each cut with a new tool. What happened comes back as the simulation's rollouts do, with the
simulation's reward computed from the cell's amounts, so tables, tests and figures are shared. There is no
clean observation in the cell: what the disturbance does to an action cannot be told there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy import signal

from mjx_cutting.deploy.export import build
from mjx_cutting.deploy.export_check import Lockstep
from mjx_cutting.deploy.runtime import PolicyRuntime
from mjx_cutting.deploy.virtual_cell import Cell, Hidden, load
from mjx_cutting.deploy.virtual_cell.hidden import from_dict
from mjx_cutting.evaluation.controllers import Controller
from mjx_cutting.evaluation.evaluate import Domain
from mjx_cutting.evaluation.rollouts import Rollouts
from mjx_cutting.loop.cell_cut import cell_config, reward_terms
from mjx_cutting.sim.config import EnvConfig

DECLARED: dict[str, dict[str, Any]] = {
    "radial_runout": {"offset_m": 1.2e-5, "angle_rad": 0.7},
    "robot_mode": {"frequency_hz": [24.0, 31.0], "damping": 0.05, "mass_kg": 40.0},
    "material_periodicity": {"amplitude": 0.15, "wavelength_m": 0.006},
    "drift": {"final_n": [1.0, -1.5, 1.0], "tau_s": 900.0},
    "sheet_pose": {"height_m": 3e-5, "slope": 1e-4},
}
"""Hidden effects where none are given: those that any cell has a little of. Ours, as tables of the TOML file:
a saw off its axis, a robot that swings, a sheet that is neither even nor flat, a sensor that drifts."""


def cell_domain(
    effects: Path | None = None,
    cuts: int = 10,
    seed: int = 0,
    told: Callable[[str], None] = lambda line: None,
) -> Domain:
    """The cell as a domain, for `evaluation.evaluate.evaluate`.

    Arguments:
        effects: TOML file with hidden effects (docs/virtual_cell.md); None: `DECLARED`.
        cuts: of each controller; a cut takes seconds.
        seed: of the first cut; the others follow it.
        told: called with a line after each controller.

    Raises:
        ValueError: the file holds an effect that is unknown or out of range.
    """
    hidden = hidden_effects(effects)

    def serve(env: EnvConfig, acting: Mapping[str, Controller]) -> dict[str, Rollouts]:
        found = {}
        for name, controller in acting.items():
            found[name] = _rollouts(env, hidden, controller, cuts, seed)
            told(f"cell: {name}, {cuts} cuts, {found[name].time_s.sum():.0f} s of the cell's time")
        return found

    return serve


def hidden_effects(effects: Path | None) -> Hidden:
    """The effects of a TOML file; those of `DECLARED` where none is given. Raises ValueError as `load`."""
    return load(effects) if effects else from_dict(DECLARED)


class _Watched(PolicyRuntime):
    """Serves a controller, and keeps what it saw and did and the amounts of the cut before each action."""

    def __init__(self, controller: Controller, env: EnvConfig):
        super().__init__(build(controller.policy))
        self._controller, self._env = controller, env
        self._entries = np.flatnonzero(np.asarray(controller.filtered))
        self._scale = np.asarray(self.artefact.observation_scales)
        self.begin(None)

    def begin(self, cell: Cell | None) -> None:
        """Forget what was, before a cut in a cell."""
        self._cell, self._memory = cell, None
        self.seen: list[np.ndarray] = []
        self.acted: list[np.ndarray] = []
        self.amounts: list[dict[str, float]] = []

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """The action [action] on an observation [observation] in physical values."""
        action = super().__call__(self._filter(np.asarray(observation, np.float64)))
        if self._cell is not None:
            self.seen.append(np.asarray(observation) / self._scale)
            self.acted.append(action)
            self.amounts.append(_amounts(self._env, self._cell))
        return action

    def _filter(self, observation: np.ndarray) -> np.ndarray:
        if not self._entries.size:
            return observation
        x = observation[None, self._entries]
        if self._memory is None:
            self._memory = np.asarray(self._controller.settled, np.float64)[:, :, None] * x
        sections = np.asarray(self._controller.sections, np.float64)
        y, self._memory = signal.sosfilt(sections, x, axis=0, zi=self._memory)
        after = observation.copy()
        after[self._entries] = y[0]
        return after


def _rollouts(env: EnvConfig, hidden: Hidden, controller: Controller, cuts: int, seed: int) -> Rollouts:
    runtime = _Watched(controller, env)
    flown = []
    for i in range(cuts):
        cell = Cell(cell_config(env, env.materials[i % len(env.materials)], seed + i), hidden)
        lockstep = Lockstep(cell, runtime)
        runtime.begin(cell)
        flight = lockstep.fly(longest_s=env.max_episode_s)
        if not runtime.acted:
            raise ValueError(
                f"got a cut in the cell in which the policy never acted ({'; '.join(flight.log)}); expected "
                "one that the server runs; see docs/serving.md for what keeps it from starting"
            )
        # Amounts add up from the first action on; what came between two actions belongs to the first.
        sums = [dict.fromkeys(runtime.amounts[0], 0.0), *runtime.amounts[1:], _amounts(env, cell)]
        steps = {name: np.diff([each[name] for each in sums]) for name in sums[0]}
        flown.append((np.stack(runtime.seen), np.stack(runtime.acted), steps))
    runtime.begin(None)
    return _padded(flown, len(env.materials), float(runtime.artefact.policy_period_s))


def _amounts(env: EnvConfig, cell: Cell) -> dict[str, float]:
    """Sums over the cut so far, by the names that the simulation's metrics have."""
    score = cell.score.to_dict()
    return {
        **reward_terms(env, score),
        "time_s": score["time_s"],
        "mrv_mm3": score["mrv_mm3"],
        "contact_s": score["contact_s"],
        "contact_load_n_s": score["load_n_s"],
        "contact_error_mm_s": score["deviation_mm_s"],
        "saturated_s": score["saturated_s"],
        "completed": float(score["completed"]),
        "failed": float(score["why"] not in ("", "finished")),
    }


def _padded(flown: list[Any], sheets: int, period_s: float) -> Rollouts:
    """One array for cuts of different lengths, [step, cut, ...]."""
    longest = max(len(seen) for seen, _, _ in flown)

    def pad(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values, np.zeros((longest - len(values), *values.shape[1:]))])

    def stack(parts: list[np.ndarray]) -> np.ndarray:
        return np.stack([pad(part) for part in parts], axis=1)

    metrics = {name: stack([steps[name] for _, _, steps in flown]) for name in flown[0][2]}
    return Rollouts(
        active=stack([np.ones(len(seen)) for seen, _, _ in flown]) > 0,
        observation=stack([seen for seen, _, _ in flown]),
        clean=None,
        action=stack([acted for _, acted, _ in flown]),
        reward=sum((v for k, v in metrics.items() if k.startswith("reward_")), np.zeros(())),
        metrics=metrics,
        material=np.arange(len(flown)) % sheets,
        period_s=period_s,
    )
