"""Which trials are run: tools, sensors, materials and cutting conditions of the blind designs.

`mill`: end mill, 4 teeth, helix, 2 or 10 kHz. `saw`: slitting saw, 20 teeth, 500 Hz behind a declared filter.
`drill`: thrust and torque of a set of drills. `turning`: one edge, three forces. Everything follows from the
seed; each matter has its own random stream, so that one choice does not shift another.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjx_cutting.trials.dataset import AntiAlias, Sensor, ToolInfo

DESIGNS = ("mill", "saw", "drill", "turning")


@dataclass(frozen=True)
class TrueCut:
    """One trial as it is really cut; `nominal_rev_s` is what the file says of the speed."""

    kind: str
    milling: str | None
    nominal_rev_s: float
    speed_rev_s: float
    feed_m_s: float
    depth_m: float
    width_m: float
    phase_rad: float
    duration_s: float
    length_before_m: float
    clock_s: float
    tool_id: str = "a"

    @property
    def path_m(self) -> float:
        """Length of the path, m."""
        return self.feed_m_s * self.duration_s


@dataclass(frozen=True)
class Plan:
    """A session: tool, sensor, constants of the material [3] (N/m^2, N/m), its cuts, and extra columns."""

    design: str
    tool: ToolInfo
    sensor: Sensor
    chip_n_m2: np.ndarray
    edge_n_m: np.ndarray
    cuts: tuple[TrueCut, ...]
    bias_n: np.ndarray
    position: bool
    feed: bool


def stream(seed: int, *names: object) -> np.random.Generator:
    """A random stream of its own for each seed and matter."""
    return np.random.default_rng([seed, *(zlib.crc32(str(name).encode()) for name in names)])


def plan(design: str, seed: int, effects: tuple[str, ...] = (), new: bool = False) -> Plan:
    """The session of a design.

    Arguments: design; seed; names of the effects to come (some need a milling, a zeroing or a column of
    theirs); new: the same tool and material at other speeds and feeds, for scoring.
    """
    if design not in DESIGNS:
        raise ValueError(f"design: got {design!r}, expected one of {', '.join(DESIGNS)}; correct the word.")
    make = {"mill": _mill, "saw": _saw, "drill": _drill, "turning": _turning}[design]
    made = make(seed, effects, new)
    once = 0.4 if design in ("mill", "saw") else 0.85  # a bias of each trial's own hides all that is constant
    zeroed = "session" if "thermal_drift" in effects or stream(seed, "zero").random() < once else "trial"
    generator = stream(seed, design, "bias", new)
    scale = {"mill": 3.0, "saw": 1.0, "drill": 2.0, "turning": 2.0}[design]
    bias = scale * generator.normal(size=(1 if zeroed == "session" else len(made.cuts), 3))
    if design == "drill":
        bias[:, 1] *= 0.01
    return replace(
        made,
        sensor=replace(made.sensor, zeroed=zeroed),
        bias_n=np.broadcast_to(bias, (len(made.cuts), 3)).copy(),
    )


def session(
    conditions: Sequence[tuple[float, float, float, float]],
    milling: str | None,
    duration_s: float,
    generator: np.random.Generator,
    *,
    between_m: float,
    air: int = 0,
    tools: int = 1,
) -> tuple[TrueCut, ...]:
    """Cuts in the order of the session from (speed, feed, depth, width), with clocks and lengths.

    The order is shuffled in two sessions of three. The true speed is off by a part common to the session and
    one of the trial, 1 % at most. Several tools take turns of equal length and start sharp.
    """
    conditions = list(conditions)
    if generator.random() < 0.67:
        generator.shuffle(conditions)
    common = generator.uniform(-0.006, 0.006)
    clock, length, cuts = 0.0, 0.0, []
    each_tool = -(-len(conditions) // tools)
    for index, (speed, feed, depth, width) in enumerate(conditions):
        if index % each_tool == 0:
            length = 0.0
        off = np.clip(common + generator.normal(0.0, 0.0012), -0.0095, 0.0095)
        cuts.append(
            TrueCut(
                "cut", milling, speed, speed * (1.0 + off), feed, depth, width,
                generator.uniform(0.0, 2.0 * np.pi), duration_s, length, clock,
                "abcdefgh"[index // each_tool],
            )
        )  # fmt: skip
        clock += duration_s + generator.uniform(30.0, 180.0) * (6.0 if generator.random() < 0.15 else 1.0)
        length += feed * duration_s + generator.uniform(0.3, 1.7) * between_m
    for index in np.linspace(0, len(cuts) - 1, air).astype(int):
        idle = replace(cuts[index], kind="air", phase_rad=generator.uniform(0.0, 6.28), clock_s=clock)
        cuts.append(replace(idle, length_before_m=length))
        clock += duration_s + 40.0
    return tuple(cuts)


def _mill(seed: int, effects: tuple[str, ...], new: bool) -> Plan:
    tool_rng, generator = stream(seed, "mill"), stream(seed, "mill", "cuts", new)
    fast = tool_rng.random() < 0.25
    rate, corner, duration = (10_000.0, 2_500.0, 0.6) if fast else (2_000.0, 700.0, 2.0)
    tool = ToolInfo("end_mill", 4, 0.016, float(np.deg2rad(tool_rng.choice([0.0, 30.0, 38.0]))))
    sensor = Sensor(rate, (0.5, 0.5, 1.0), anti_alias=AntiAlias(order=4, hz=corner))
    milling = str(tool_rng.choice(["slot", "slot", "conventional", "climb"]))
    if "static_compliance" in effects and milling == "slot":
        milling = "conventional"
    chip = np.array([8e8, 2.4e8, 1.2e8]) * np.exp(tool_rng.normal(0.0, 0.25, 3))
    edge = np.array([2e4, 1.8e4, 3e3]) * np.exp(tool_rng.normal(0.0, 0.25, 3))
    depths = [0.016] if milling == "slot" else [0.004, 0.007]
    speeds = (45.0, 61.0) if new else (40.0, 52.0, 66.0)
    teeth_m = (3.3e-5, 1.4e-4) if new else (2e-5, 6e-5, 2e-4)
    width = float(tool_rng.choice([0.002, 0.003]))
    conditions = [(f, 4 * f * c, a, width) for f in speeds for c in teeth_m for a in depths]
    if not new and len(conditions) > 12:
        kept = generator.permutation(len(conditions))[:12]
        conditions = [conditions[i] for i in sorted(kept)]
    air = 0 if new else int(tool_rng.integers(0, 3))
    cuts = session(conditions, milling, duration, generator, between_m=2.0, air=air)
    stair = "command_stair" in effects
    return Plan("mill", tool, sensor, chip, edge, cuts, np.zeros(3), False, stair)


def _saw(seed: int, effects: tuple[str, ...], new: bool) -> Plan:
    tool_rng, generator = stream(seed, "saw"), stream(seed, "saw", "cuts", new)
    tool = ToolInfo("slitting_saw", 20, 0.05)
    sensor = Sensor(500.0, (0.1, 0.1, 0.2), anti_alias=AntiAlias(order=4, hz=200.0))
    milling = "climb" if tool_rng.random() < 0.2 else "conventional"
    chip = np.array([6e8, 1.9e8, 0.5e8]) * np.exp(tool_rng.normal(0.0, 0.3, 3))
    edge = np.array([1e4, 4e3, 8e2]) * np.exp(tool_rng.normal(0.0, 0.3, 3))
    base = float(tool_rng.choice([9.0, 13.0, 19.0]))
    wide = tool_rng.random() < 0.5
    speeds = base * np.array([0.94, 1.07] if new else [0.89, 1.0, 1.13])
    feeds = np.array(([0.005, 0.02] if new else [0.003, 0.01, 0.03]) if wide else (
        [0.009, 0.018] if new else [0.00625, 0.0125, 0.025]))  # fmt: skip
    depths = (0.0009, 0.0016) if new else (0.0007, 0.002 if tool_rng.random() < 0.5 else 0.0014)
    conditions = [(f, v, a, 0.0016) for f in speeds for v in feeds for a in depths]
    if not new:
        kept = generator.permutation(len(conditions))[: int(generator.integers(12, 16))]
        conditions = [conditions[i] for i in sorted(kept)]
    air = 0 if new else int(tool_rng.integers(0, 3))
    cuts = session(conditions, milling, 8.0, generator, between_m=1.0, air=air)
    position = tool_rng.random() < 0.5
    feed = tool_rng.random() < 0.33 or "command_stair" in effects
    return Plan("saw", tool, sensor, chip, edge, cuts, np.zeros(3), position, feed)


def _drill(seed: int, effects: tuple[str, ...], new: bool) -> Plan:
    tool_rng, generator = stream(seed, "drill"), stream(seed, "drill", "cuts", new)
    tool = ToolInfo("drill", 2, 0.008, 0.0)
    sensor = Sensor(500.0, None, anti_alias=AntiAlias(order=4, hz=200.0))
    chip = np.array([1.2e9, 0.0, 6e8]) * np.exp(tool_rng.normal(0.0, 0.25, 3))
    edge = np.array([3e4, 0.0, 4e4]) * np.exp(tool_rng.normal(0.0, 0.25, 3))
    speeds = (17.0, 24.0) if new else (15.0, 20.0, 27.0)
    turns_m = (7e-5, 1.6e-4) if new else (3e-5, 1e-4, 2.4e-4)
    once = [(f, f * c, 0.004, 0.004) for f in speeds for c in turns_m]
    conditions = once * (1 if new else 2)
    cuts = session(conditions, None, 4.0, generator, between_m=0.0, tools=1 if new else 3)
    feed = "command_stair" in effects
    return Plan("drill", tool, sensor, chip, edge, cuts, np.zeros(3), False, feed)


def _turning(seed: int, effects: tuple[str, ...], new: bool) -> Plan:
    tool_rng, generator = stream(seed, "turning"), stream(seed, "turning", "cuts", new)
    tool = ToolInfo("turning", 1, 0.05, 0.0)
    sensor = Sensor(500.0, (0.5, 0.5, 0.5), anti_alias=AntiAlias(order=4, hz=200.0))
    chip = np.array([1.5e9, 6e8, 3e8]) * np.exp(tool_rng.normal(0.0, 0.25, 3))
    edge = np.array([4e4, 4e4, 1e4]) * np.exp(tool_rng.normal(0.0, 0.25, 3))
    speeds = (12.0, 17.0) if new else (10.0, 14.0, 20.0)
    turns_m = (8e-5, 2e-4) if new else (4e-5, 1.3e-4, 3e-4)
    conditions = [
        (f, f * c, b, b) for f in speeds for c in turns_m for b in ((0.0014,) if new else (0.001, 0.002))
    ]
    if not new:
        kept = generator.permutation(len(conditions))[:14]
        conditions = [conditions[i] for i in sorted(kept)]
    air = 0 if new else int(tool_rng.integers(0, 2))
    cuts = session(conditions, None, 4.0, generator, between_m=2.0, air=air)
    return Plan("turning", tool, sensor, chip, edge, cuts, np.zeros(3), False, "command_stair" in effects)
