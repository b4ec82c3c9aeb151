"""Small data sets with a known cause, made apart from the force path."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.study.designs import plan
from benchmarks.study.generator import recorded
from mjx_cutting.tracing.fitting.problem import Problem, pose
from mjx_cutting.tracing.records.lines import Lines, compress, trusted_band
from mjx_cutting.trials.dataset import AntiAlias, Dataset, Sensor, ToolInfo
from mjx_cutting.trials.synthetic import Conditions, Hidden, Sheet, make_trials

MILL = ToolInfo("end_mill", 4, 0.016, 0.5)
MILL_SHEET = Sheet((8e8, 2.4e8, 1.2e8), (2e4, 1.6e4, 4e3))
MILL_CUTS = [
    Conditions(speed, speed * 4 * chip, 0.016, 0.002)
    for speed in (40.0, 60.0)
    for chip in (2e-5, 5e-5, 1.2e-4)
]
SAW = ToolInfo("slitting_saw", 20, 0.05)
SAW_SHEET = Sheet((6e8, 1.8e8, 0.0), (1e4, 4e3, 0.0))
SAW_CUTS = [
    Conditions(speed, speed * 20 * chip, depth, 0.0016, "conventional")
    for speed, chip, depth in (
        (17.0, 1e-5, 1e-3),
        (17.0, 4e-5, 1e-3),
        (19.0, 2e-5, 1e-3),
        (19.0, 6e-5, 4e-3),
        (18.0, 3e-5, 3e-3),
    )
]


@pytest.fixture(scope="session")
def mill():
    """Six slots with an end mill; call it with the hidden effects and a seed."""

    def make(hidden: Hidden | None = None, seed: int = 3, **rest) -> Dataset:
        sensor = Sensor(5000.0, (0.5, 0.5, 1.0), anti_alias=AntiAlias(order=4, hz=1000.0), **rest)
        return make_trials(MILL, MILL_SHEET, MILL_CUTS, sensor, hidden=hidden, duration_s=0.8, seed=seed)

    return make


@pytest.fixture(scope="session")
def hiding():
    """Call it with effects by name with parameters of their own: a session of the study, an end mill's where
    no other design is named."""

    def make(effects: dict, seed: int = 401, design: str = "mill") -> Dataset:
        session, trials = recorded(plan(design, seed), effects, seed)
        told = {"name": "hiding", "source": "benchmarks/study", "licence": "Apache-2.0"}
        return Dataset(**told, tool=session.tool, sensor=session.sensor, trials=trials)

    return make


@pytest.fixture(scope="session")
def strained():
    """Call it with a way [T] and a presliding distance, m: strain of the contacts, by small steps."""

    def along(way_m: np.ndarray, presliding_m: float) -> np.ndarray:
        strain, last = np.zeros(len(way_m)), 0.0
        for index, step in enumerate(np.diff(way_m)):
            for _ in range(10):
                last += (step - abs(step) * last) / (10.0 * presliding_m)
            strain[index + 1] = last
        return strain

    return along


@pytest.fixture(scope="session")
def posed():
    """Call it with a data set, in float64: its lines and the fitting problem."""

    def make(dataset: Dataset) -> tuple[Lines, Problem]:
        lines = compress(dataset, trusted_band(dataset, None))
        return lines, pose(dataset, lines)

    return make


@pytest.fixture(scope="session")
def mill_sheet() -> Sheet:
    """What the trials of `mill` cut."""
    return MILL_SHEET


@pytest.fixture(scope="session")
def saw():
    """Five cuts with a slitting saw behind a 500 Hz sensor with its anti-alias filter."""

    def make(hidden: Hidden | None = None, seed: int = 3) -> Dataset:
        sensor = Sensor(500.0, (0.1, 0.1, 0.2), anti_alias=AntiAlias(order=4, hz=200.0))
        return make_trials(SAW, SAW_SHEET, SAW_CUTS, sensor, hidden=hidden, duration_s=4.0, seed=seed)

    return make


@pytest.fixture(scope="session")
def names_the_edge():
    """Checks that a verdict names entry alone, where the sheet truly begins and as the geometry has it."""

    def check(verdict: dict, start_m: float) -> None:
        (effect,) = verdict["effects"]
        assert effect["name"] == "entry_exit"
        assert effect["parameters"]["start_m"]["value"] == pytest.approx(start_m, abs=1.5e-4)
        assert effect["parameters"]["share"]["value"] == pytest.approx(1.0, abs=0.02)
        assert verdict["after"]["heldout_nrmse"] < 0.1 * verdict["before"]["heldout_nrmse"]

    return check
