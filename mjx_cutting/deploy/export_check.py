"""Sim-to-sim: a policy flown in C MuJoCo before it is exported, with a verdict that travels with it.

The policy runs in the virtual cell (deploy/virtual_cell: other physics code, another controller, friction, no
hidden effects) behind the policy server, packet by packet, on a soft and a stiff sheet. The verdict asks what
every policy must show before it meets hardware, trained or not: numbers stay finite, no limit of force,
deviation or joint is passed, no torque saturates for long, and where the path is finished the tool followed
its reference. It says nothing about how well the policy cuts; the amounts beside it do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.protocol import State
from mjx_cutting.deploy.runtime import PolicyRuntime
from mjx_cutting.deploy.server import Server, Settings
from mjx_cutting.deploy.virtual_cell import Cell, CellConfig

SHEETS = ("plastic", "aluminium")
LIMITS = {"worst_load_n": 250.0, "worst_deviation_mm": 150.0, "saturated_share": 0.05}
"""Largest 20 ms mean load, N, and path error, mm (as the simulation and the server end a cut), and share of the
time with a clipped torque."""
TICK_NS = 1_000_000
ADDRESS = ("127.0.0.1", 1)
Record = Callable[[int, State, np.ndarray, int], None]


@dataclass(frozen=True)
class Flight:
    """One trial of the cell. Fields: `score`, the cell's plain numbers; `log` of the server."""

    score: dict[str, Any]
    log: tuple[str, ...]


def fly(
    cell: Cell, runtime: PolicyRuntime, *, record: Record | None = None, longest_s: float = 60.0
) -> Flight:
    """One trial in lock step: the cell's clock is the only one, and packets pass through memory.

    Arguments:
        cell: set up for a new trial.
        runtime: the policy.
        record: told every sample while the server runs, as `Server` says.
        longest_s: time after which the trial is given up.
    """
    log: list[str] = []
    server = Server(runtime, Settings(), log.append, record)
    period = round(runtime.artefact.policy_period_s * 1e3)
    now = 0
    for tick in range(round(longest_s * 1e3)):
        now += TICK_NS
        for data in cell.tick(now):
            answer = server.handle(data, ADDRESS, now)
            if answer is not None:
                cell.receive(answer, now)
        if tick % period == period - 1:
            command = server.tick(now)
            if command is not None:
                cell.receive(command, now)
        if cell.done:
            break
    return Flight(cell.score.to_dict(), tuple(log))


def check(artefact: Artefact, *, episodes: int = 1, cut_m: float = 0.06, seed: int = 0) -> dict[str, Any]:
    """The verdict on a policy, plain: "passed", "reasons", and the amounts of every flight.

    Arguments:
        artefact: the policy.
        episodes: flights on each sheet of `SHEETS`.
        cut_m: length cut in each, m.
        seed: of the cell.
    """
    flights, reasons = [], []
    for sheet in SHEETS:
        cell = Cell(CellConfig(material=sheet, approach_m=0.01, cut_m=cut_m, seed=seed))
        for episode in range(episodes):
            if episode:
                cell.new_trial()
            flight = fly(cell, PolicyRuntime(artefact))
            flights.append({"material": sheet, **_amounts(flight.score)})
            reasons += [f"{sheet}: {reason}" for reason in _judge(flight.score, cut_m)]
    return {
        "passed": not reasons,
        "reasons": reasons,
        "limits": LIMITS,
        "simulator": "mjx_cutting.deploy.virtual_cell, C MuJoCo at 1 kHz, no hidden effects",
        "flights": flights,
    }


def _judge(score: dict[str, Any], cut_m: float) -> list[str]:
    reasons = []
    numbers = [v for v in score.values() if isinstance(v, float)]
    if not np.isfinite(numbers).all():
        reasons.append("a number that is not finite")
    for name in ("worst_load_n", "worst_deviation_mm"):
        if not score[name] <= LIMITS[name]:
            reasons.append(f"{name} is {score[name]:.3g}, more than {LIMITS[name]:g}")
    share = score["saturated_s"] / max(score["time_s"], 1e-9)
    if not share <= LIMITS["saturated_share"]:
        reasons.append(f"torques saturated for {share:.0%} of the time, more than 5 %")
    if score["why"] not in ("finished", ""):
        reasons.append(f"the cut was stopped: {score['why']}")
    return reasons


def _amounts(score: dict[str, Any]) -> dict[str, Any]:
    names = (
        "completed", "why", "time_s", "path_m", "mrv_mm3", "load_n", "deviation_mm", "worst_load_n",
        "worst_deviation_mm", "saturated_s",
    )  # fmt: skip
    return {name: score[name] for name in names}
