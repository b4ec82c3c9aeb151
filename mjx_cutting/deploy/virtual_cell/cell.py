"""Robot, tool and sheet as one thing that is ticked each millisecond and talks in packets.

A tick: packets that have come are taken, set-points are interpolated, the saw turns by a millisecond while
its centre moves as it does, the force acts on the arm, and every second tick a sample of the sensor leaves as
a STATE. Process axes to base axes: x_b = z_p, y_b = -x_p, z_b = -y_p.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.deploy.protocol import Command, Mode, Robot, State, Welcome
from mjx_cutting.deploy.virtual_cell.arm import Arm
from mjx_cutting.deploy.virtual_cell.endpoint import Endpoint
from mjx_cutting.deploy.virtual_cell.follower import Follower, Goal, Phase
from mjx_cutting.deploy.virtual_cell.hidden import Hidden
from mjx_cutting.deploy.virtual_cell.kerf import Kerf
from mjx_cutting.deploy.virtual_cell.network import Wire
from mjx_cutting.deploy.virtual_cell.saw import Blade, Saw, Sheet
from mjx_cutting.deploy.virtual_cell.score import Score
from mjx_cutting.deploy.virtual_cell.sensor import Sensor
from mjx_cutting.deploy.virtual_cell.sheets import constants
from mjx_cutting.deploy.virtual_cell.structure import Structure

Array = NDArray[np.float64]
TICK_NS = 1_000_000
SLOTS = 8
_TURN = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
_MEAN = np.full(SLOTS, 1.0 / SLOTS)
TOO_MUCH_N, TOO_FAR_M = 400.0, 0.2
"""Load and path error at which the robot's own supervision stops it, whatever the server thinks."""


@dataclass(frozen=True)
class CellConfig:
    """The cell as drawn. Fields: `material` of the sheet; `start_m` x, y of the path's start and
    `surface_m` nominal height of the sheet's top, base frame; `approach_m` before and `cut_m` over the sheet;
    saw `teeth`, `diameter_m`, `kerf_m`, `spindle_rev_s`; `friction` factor of the joints; `seed`."""

    material: str = "aluminium"
    start_m: tuple[float, float] = (0.52, 0.30)
    surface_m: float = 0.110
    approach_m: float = 0.030
    cut_m: float = 0.220
    teeth: int = 20
    diameter_m: float = 0.050
    kerf_m: float = 0.0016
    spindle_rev_s: float = 19.0
    friction: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        constants(self.material)
        for name, low, high in (
            ("approach_m", 0.0, 0.2), ("cut_m", 0.001, 0.5), ("teeth", 1, 200), ("diameter_m", 0.02, 0.2),
            ("kerf_m", 1e-4, 0.02), ("spindle_rev_s", 0.1, 100.0), ("friction", 0.0, 20.0),
        ):  # fmt: skip
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"got {name} = {getattr(self, name)}; expected {low:g} to {high:g}")


class Cell:
    """A session at the cell: one tool, trial after trial.

    Arguments: config, hidden effects, `key` shared with the server.

    Fields: `clock_s` and `cut_length_m` of the session; `score` of the running trial; `endpoint`, `follower`.

    Raises:
        ValueError: the path cannot be reached, or the spindle is too fast for its teeth.
    """

    def __init__(self, config: CellConfig, hidden: Hidden | None = None, key: bytes | None = None):
        self.config, self.hidden, self._key = config, hidden or Hidden(), key
        self.sheet = constants(config.material)
        self.arm = Arm((*config.start_m, config.surface_m), config.friction)
        self.structure = Structure(self.hidden.robot_mode)
        effects = self.hidden
        self.sensor = Sensor(
            SLOTS, effects.sensor_lowpass, effects.sensor_resonance, effects.drift, config.seed + 1
        )
        self._draw = np.random.default_rng(config.seed)
        self._wires = [Wire(effects.network, config.seed + 2 + k) for k in range(2)]
        self.clock_s, self.cut_length_m, self._sessions = 0.0, 0.0, 0
        self._chip = effects.resistance.chip * np.asarray(self.sheet.chip_n_m2)
        self._edge = effects.resistance.edge * np.asarray(self.sheet.edge_n_m)
        self._growth = effects.wear.per_m * np.array([1.0, effects.wear.radial_ratio, 1.0])
        self.follower = Follower(config.approach_m + config.cut_m)
        self.new_trial()

    def new_trial(self) -> None:
        """A new sheet, the arm back at the start, the sensor zeroed, a new session with the server."""
        config, radius = self.config, 0.5 * self.config.diameter_m
        ends = config.approach_m, config.approach_m + config.cut_m
        self.arm.reset()
        self.structure.reset()
        self.sensor.reset(self.clock_s)
        self.saw = Saw(
            self._blade(),
            Sheet(*ends, self.sheet.thickness_m),
            config.spindle_rev_s,
            slots=SLOTS,
            angle_rad=self._draw.uniform(0.0, 2.0 * np.pi),
        )
        self.kerf = Kerf(*ends, self.sheet.thickness_m, radius)
        self._sessions += 1
        self.endpoint = Endpoint(int(self._draw.integers(1, 2**32)), self._key)
        self.follower.welcome = None
        self.follower.reset()
        self.score, self._ticks, self._fault = Score(), 0, False
        self._used = np.array(self._centre()[:2])
        self._place = self.arm.tip_m
        self._load, self._lever = np.zeros(3), np.zeros(3)
        self._error = np.zeros(3)

    @property
    def done(self) -> bool:
        """Whether the trial is over: the tool is clear of the sheet and the server stands."""
        at_rest = self.endpoint.mode in (Mode.IDLE, Mode.FAULT) or self.follower.why == "silence"
        return self.follower.phase is Phase.CLEAR and at_rest

    def receive(self, data: bytes, now_ns: int) -> None:
        """A datagram from the server."""
        self._wires[0].put(data, now_ns)

    def tick(self, now_ns: int) -> list[bytes]:
        """One millisecond; returns the datagrams for the server."""
        for data in self._wires[0].take(now_ns):
            body = self.endpoint.receive(data)
            if isinstance(body, Welcome):
                self.follower.welcomed(body)
            elif isinstance(body, Command):
                self.follower.command(body, now_ns)
        self._advance(self.follower.tick(now_ns))
        if self.follower.phase is not Phase.HOLDING:
            self.endpoint.wish = Mode.RUNNING if self.follower.phase is Phase.CUTTING else Mode.IDLE
        out = [self.endpoint.ask(now_ns)]
        if self._ticks % 2 == 0:
            out.append(self.endpoint.state(self._state(), now_ns))
        for packet in out:
            if packet is not None:
                self._wires[1].put(packet, now_ns)
        return self._wires[1].take(now_ns)

    def _advance(self, goal: Goal) -> None:
        """The physics of one millisecond."""
        config, hidden, arm = self.config, self.hidden, self.arm
        cutting = self.follower.phase is Phase.CUTTING and not self.follower.finished
        along, up = self._used
        place = self._centre()
        ahead = np.array([place[0] + 1e-3 * place[2], place[1] + 1e-3 * place[3]])
        pose = hidden.sheet_pose
        depth = config.surface_m + pose.height_m + pose.slope * along - up
        chip, edge = self._resistance(along)
        sweep = self.saw.step((ahead[0] - along, ahead[1] - up), along, depth, chip, edge)
        self._used = ahead
        # the force is that of the saw at this place, not of where the arm will have gone by then
        self._place = arm.tip_m + 1e-3 * arm.velocity_m_s
        mean = _MEAN @ sweep.force_n
        self._load = _to_base(mean)
        radius = 0.5 * config.diameter_m
        sine, cosine = math.sin(sweep.arm_rad), math.cos(sweep.arm_rad)
        self._lever = (
            np.array([0.0, -radius * sine, radius * (1.0 - cosine)]) if sweep.contact else np.zeros(3)
        )
        self.structure.step(mean[:2])
        wish = np.array([config.start_m[0], config.start_m[1] - goal.path_m, config.surface_m - goal.depth_m])
        arm.step(wish, np.array([0.0, -goal.feed_m_s, -goal.sink_m_s]), goal.gain_s2, self._load, self._lever)
        # the wrist feels the mean load in MuJoCo; here the course of it within the millisecond is added
        inertia = _to_base(np.array([*self.structure.inertia_n, 0.0]))
        felt = _to_base(sweep.force_n) + (arm.wrist_n - self._load - inertia)
        self.sensor.feed(felt)
        self._error = wish - arm.tip_m
        self.clock_s += 1e-3
        self._ticks += 1
        area = self.kerf.cut(along, depth) if self._ticks % 2 else 0.0
        if sweep.contact:
            self.cut_length_m += 1e-3 * max(0.0, float(-arm.velocity_m_s[1]))
        if cutting:
            self.score.add(
                self._load, self._error, sweep.contact, 1e9 * config.kerf_m * area, 1e9 * sweep.removed_m3,
                arm.saturated,
            )  # fmt: skip
        self._judge(goal)

    def _judge(self, goal: Goal) -> None:
        """The robot's own supervision, and how the trial ended."""
        if self._ticks % 2 == 0 and not self._fault:
            felt, away = self.sensor.filtered_n, self._error
            well = float(felt @ felt) < TOO_MUCH_N**2 and float(away @ away) < TOO_FAR_M**2
            if not (well and self.arm.sound):  # numbers that are not finite are not well either
                self._fault = True
                self.follower.fault("robot")
        self.score.path_m = float(goal.path_m)
        self.score.completed, self.score.why = self.follower.finished, self.follower.why

    def _state(self) -> State:
        flags = Robot.SPINDLE_ANGLE | Robot.SPINDLE_SPEED
        flags |= Robot.FAULT if self._fault else Robot.READY
        if self.follower.finished:
            flags |= Robot.FINISHED
        arm = self.arm
        speed = float(-arm.velocity_m_s[1])
        error = self._error + arm.tip_m - self._place
        return State(
            int(flags), self.endpoint.taken, _three(error), _three(arm.velocity_m_s),
            _three(self._place), _three(self.sensor.sample(self.clock_s)), speed, float(self.follower.path_m),
            self.cut_length_m, self.saw.angle_rad, self.config.spindle_rev_s,
        )  # fmt: skip

    def _centre(self) -> tuple[float, float, float, float]:
        """Path position and height of the saw's lowest point, and their rates; with the structure's swing."""
        tip, speed = self.arm.tip_m, self.arm.velocity_m_s
        swing, rate = self.structure.shift_m, self.structure.speed_m_s
        return (
            self.config.start_m[1] - tip[1] + swing[0], tip[2] - swing[1],
            rate[0] - speed[1], speed[2] - rate[1],
        )  # fmt: skip

    def _blade(self) -> Blade:
        config, hidden = self.config, self.hidden
        even = 2.0 * np.pi * np.arange(config.teeth) / config.teeth
        error = np.zeros(config.teeth)
        given = hidden.unequal_pitch.error_rad
        if len(given) > config.teeth:
            raise ValueError(f"got {len(given)} pitch errors; expected at most {config.teeth}, one a tooth")
        error[: len(given)] = given
        late = np.cumsum(error - error.mean())
        runout = hidden.radial_runout
        reach = runout.offset_m * np.cos(runout.angle_rad - even)
        return Blade(0.5 * config.diameter_m, config.kerf_m, even + late - late[0], reach)

    def _resistance(self, along_m: float) -> tuple[Array, Array]:
        """Constants [3] of chip and edge here and now."""
        ripple = self.hidden.material_periodicity
        turn = 2.0 * math.pi * along_m / ripple.wavelength_m + ripple.phase_rad
        harder = 1.0 + ripple.amplitude * math.cos(turn)
        return harder * self._chip, (harder * (1.0 + self.cut_length_m * self._growth)) * self._edge


def _to_base(process: Array) -> Array:
    """[..., 3] forces in base axes from process axes."""
    return process @ _TURN


def _three(vector: Array) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])
