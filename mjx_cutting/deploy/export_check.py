"""Sim-to-sim: a policy flown in C MuJoCo before it is exported, with a verdict that travels with it.

The policy runs in the virtual cell (deploy/virtual_cell: other physics code, another controller, friction, no
hidden effects) behind the policy server, packet by packet, on a soft and a stiff sheet. The verdict asks what
every policy must show before it meets hardware, trained or not: numbers stay finite, no limit of force,
deviation or joint is passed, no torque saturates for long, and where the path is finished the tool followed
its reference. It says nothing about how well the policy cuts; the amounts beside it do.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.observing import Observer
from mjx_cutting.deploy.protocol import State
from mjx_cutting.deploy.runtime import PolicyRuntime
from mjx_cutting.deploy.server import Server, Settings
from mjx_cutting.deploy.virtual_cell import Cell, CellConfig

SHEETS = ("plastic", "aluminium")
LIMITS = {"worst_load_n": 250.0, "worst_deviation_mm": 150.0, "saturated_share": 0.05}
"""Largest 20 ms mean load, N, and path error, mm (as the simulation and the server end a cut), and share of
the time with a clipped torque."""
TICK_NS = 1_000_000
ADDRESS = ("127.0.0.1", 1)
Record = Callable[[int, State, np.ndarray, int], None]


@dataclass(frozen=True)
class Flight:
    """One trial of the cell. Fields: `score`, the cell's plain numbers; `log` of the server."""

    score: dict[str, Any]
    log: tuple[str, ...]


class Lockstep:
    """A cell and a server on one clock: packets pass through memory, and time goes as fast as it can.

    Arguments:
        cell: with its first trial set up.
        runtime: the policy served first.
        record: told every sample while the server runs, as `Server` says.
    """

    def __init__(self, cell: Cell, runtime: PolicyRuntime, record: Record | None = None):
        self.cell, self._log = cell, list[str]()
        self.server = Server(runtime, Settings(), self._log.append, record)
        self._now_ns, self._flown = 0, False

    def fly(self, runtime: PolicyRuntime | None = None, *, longest_s: float = 60.0) -> Flight:
        """One trial, of another policy where given; given up after `longest_s`.

        Raises:
            ValueError: the server still moves after the trial before, and takes no other policy.
        """
        cell, server = self.cell, self.server
        server.release()
        if self._flown:
            cell.new_trial()
        if runtime is not None and not server.swap(runtime):
            raise ValueError(f"got a new policy while the server is {server.mode.name}; expected it at rest")
        self._flown = True
        self._log.clear()
        period = round(server.runtime.artefact.policy_period_s * 1e3)
        for tick in range(round(longest_s * 1e3)):
            self._now_ns += TICK_NS
            for data in cell.tick(self._now_ns):
                answer = server.handle(data, ADDRESS, self._now_ns)
                if answer is not None:
                    cell.receive(answer, self._now_ns)
            if tick % period == period - 1:
                command = server.tick(self._now_ns)
                if command is not None:
                    cell.receive(command, self._now_ns)
            if cell.done:
                break
        return Flight(cell.score.to_dict(), tuple(self._log))


def checked(artefact: Artefact, *, allow_failed: bool = False, **options: Any) -> Artefact:
    """The artefact with the verdict of `check` in its provenance, under "sim_to_sim".

    Arguments: artefact; allow_failed, to let a policy pass that failed; options of `check`.

    Raises:
        ValueError: the policy failed.
    """
    verdict = check(artefact, **options)
    if verdict["passed"] is False and not allow_failed:
        raise ValueError(
            f"got a policy that fails the check in C MuJoCo ({'; '.join(verdict['reasons'])}); expected one "
            "that passes; train it further, or export it all the same with --allow-failed-check"
        )
    return dataclasses.replace(artefact, provenance={**artefact.provenance, "sim_to_sim": verdict})


def check(
    artefact: Artefact,
    *,
    episodes: int = 1,
    cut_m: float = 0.02,
    longest_s: float = 12.0,
    seed: int = 0,
) -> dict[str, Any]:
    """The verdict on a policy, plain: "passed", "reasons", and the amounts of every flight.

    "passed" is None for a policy that the packets cannot serve (other observations or actions): not flown.

    Arguments:
        artefact: the policy.
        episodes: flights on each sheet of `SHEETS`.
        cut_m: length cut in each, m.
        longest_s: time after which a flight ends; a slow policy need not finish.
        seed: of the cell.
    """
    flights, reasons = [], []
    try:
        Observer(artefact)
    except ValueError as error:
        return {"passed": None, "reasons": [f"not flown: {error}"], "limits": LIMITS, "flights": []}
    for sheet in SHEETS:
        cell = Cell(CellConfig(material=sheet, approach_m=0.005, cut_m=cut_m, seed=seed))
        lockstep = Lockstep(cell, PolicyRuntime(artefact))
        for _ in range(episodes):
            flight = lockstep.fly(longest_s=longest_s)
            flights.append({"material": sheet, **_amounts(flight.score)})
            reasons += [f"{sheet}: {reason}" for reason in _judge(flight.score)]
    return {
        "passed": not reasons,
        "reasons": reasons,
        "limits": LIMITS,
        "simulator": "mjx_cutting.deploy.virtual_cell, C MuJoCo at 1 kHz, no hidden effects",
        "flights": flights,
    }


def _judge(score: dict[str, Any]) -> list[str]:
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
