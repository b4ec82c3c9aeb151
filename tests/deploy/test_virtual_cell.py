"""The virtual cell's parts against published formulas and closed forms; it shares no code with us."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

import mjx_cutting.deploy.virtual_cell as package
from mjx_cutting.deploy.virtual_cell.arm import Arm
from mjx_cutting.deploy.virtual_cell.hidden import (
    Drift,
    Hidden,
    RobotMode,
    SensorLowpass,
    SensorResonance,
    from_dict,
    load,
    to_dict,
)
from mjx_cutting.deploy.virtual_cell.kerf import Kerf
from mjx_cutting.deploy.virtual_cell.saw import Blade, Saw, Sheet
from mjx_cutting.deploy.virtual_cell.sensor import NOISE_N, Sensor
from mjx_cutting.deploy.virtual_cell.structure import Structure

FOLDER = Path(package.__file__).parent
START = (0.52, 0.30, 0.11)
CHIP, EDGE = np.array([640e6, 100e6, 50e6]), np.array([40e3, 6.5e3, 3e3])
TEETH, RADIUS, KERF, SPEED, FEED = 20, 0.025, 1.6e-3, 19.0, 0.0125


def saw(reach: np.ndarray | None = None, lag: np.ndarray | None = None, start_m: float = 0.002) -> Saw:
    even = 2.0 * np.pi * np.arange(TEETH) / TEETH
    blade = Blade(RADIUS, KERF, even if lag is None else lag, np.zeros(TEETH) if reach is None else reach)
    return Saw(blade, Sheet(start_m, 9.0, 0.005), SPEED)


def cut(tool: Saw, depth_m: float, steps: int = 2000) -> tuple[np.ndarray, np.ndarray]:
    """[steps, 3] mean force of each millisecond and [steps] chip volume of a straight cut into the sheet."""
    force, volume = [], []
    for k in range(steps):
        sweep = tool.step((FEED * 1e-3, 0.0), (k - 200) * FEED * 1e-3, depth_m, CHIP, EDGE)
        force.append(sweep.force_n.mean(axis=0))
        volume.append(sweep.removed_m3)
    return np.array(force), np.array(volume)


def mean_force(depth_m: float) -> np.ndarray:
    """Mean force over a turn of the linear edge law, arc 0 to acos(1 - a/R), integrated by hand."""
    leave = np.arccos(1.0 - depth_m / RADIUS)
    chip, share = FEED / (TEETH * SPEED), TEETH * KERF / (2.0 * np.pi)
    one, sine, less = leave, np.sin(leave), 1.0 - np.cos(leave)
    squares, mixed = 0.5 * (leave - 0.5 * np.sin(2.0 * leave)), 0.5 * np.sin(leave) ** 2
    (kt, kr, ka), (et, er, ea) = CHIP * chip, EDGE
    return share * np.array(
        [
            -(et * sine + kt * mixed + er * less + kr * squares),
            et * less + kt * squares - er * sine - kr * mixed,
            -(ea * one + ka * less),
        ]
    )


@pytest.mark.parametrize(("depth_m", "tolerance"), [(1e-3, 0.005), (3e-5, 0.02)])
def test_mean_force_is_the_mechanistic_one(depth_m: float, tolerance: float) -> None:
    force, volume = cut(saw(), depth_m)
    turns = slice(1000, 2000)  # 19 turns
    expected = mean_force(depth_m)
    assert np.abs(force[turns].mean(axis=0) - expected).max() < tolerance * np.abs(expected).max()
    assert volume[turns].sum() == pytest.approx(KERF * depth_m * FEED, rel=0.02)


def test_runout_moves_chips_between_teeth_and_removes_no_more() -> None:
    force, volume = cut(saw(reach=1.2e-5 * np.cos(2.0 * np.pi * np.arange(TEETH) / TEETH)), 1e-3)
    clean, _ = cut(saw(), 1e-3)
    assert volume[1000:].sum() == pytest.approx(KERF * 1e-3 * FEED, rel=0.02)
    assert spectrum(force, SPEED) > 20.0 * spectrum(clean, SPEED)


def test_unequal_pitch_is_seen_once_a_turn() -> None:
    error = 0.03 * np.sin(2.0 * np.pi * np.arange(TEETH) / TEETH)
    lag = 2.0 * np.pi * np.arange(TEETH) / TEETH + np.cumsum(error - error.mean())
    force, volume = cut(saw(lag=lag - lag[0]), 1e-3)
    assert spectrum(force, SPEED) > 20.0 * spectrum(cut(saw(), 1e-3)[0], SPEED)
    assert volume[1000:].sum() == pytest.approx(KERF * 1e-3 * FEED, rel=0.02)


def test_air_and_the_far_end_carry_no_force() -> None:
    tool = saw(start_m=0.0)
    tool.sheet = Sheet(0.0, 0.004, 0.005)
    force = np.array(
        [tool.step((2e-5, 0.0), k * 2e-5 - 0.03, 1e-3, CHIP, EDGE).force_n.sum() for k in range(3000)]
    )
    cutting = np.flatnonzero(force)
    first, last = cutting[0] * 2e-5 - 0.03, cutting[-1] * 2e-5 - 0.03
    reach = np.sqrt(2.0 * RADIUS * 1e-3)
    assert -reach - 2e-4 < first < -reach + 2e-3  # the front of the circle comes first
    assert last < 0.004 + 1e-3


def test_spindle_too_fast_for_the_teeth() -> None:
    with pytest.raises(ValueError, match="expected less"):
        Saw(saw().blade, Sheet(0.0, 1.0, 0.005), 60.0)


def test_kerf_holds_what_the_circle_swept() -> None:
    kerf = Kerf(0.0, 0.1, 0.005, RADIUS)
    area = sum(kerf.cut(x, 1e-3) for x in np.arange(-0.03, 0.13, 1e-4))
    assert area == pytest.approx(0.1 * 1e-3, rel=0.005)
    assert sum(kerf.cut(x, 1e-3) for x in np.arange(-0.03, 0.13, 1e-4)) == 0.0


# -- robot


def test_deflection_is_that_of_the_effective_mass() -> None:
    """e = K_p^-1 (J_v M^-1 J_v^T) F, from MuJoCo's own matrices, without friction."""
    arm = Arm(START, friction=0.0)
    mass, jacobian = np.zeros((7, 7)), np.zeros((3, 7))
    mujoco.mj_fullM(arm.model, arm.data, mass)
    mujoco.mj_jacSite(arm.model, arm.data, jacobian, None, arm.model.site("tip").id)
    mass -= np.diag(arm.model.dof_armature)
    gains, force = np.array([2450.0, 2080.0, 530.0]), np.array([0.2, 0.8, -0.5])
    hold(arm, gains, force, 1500)
    expected = (jacobian @ np.linalg.solve(mass, jacobian.T) @ force) / gains
    assert np.abs(arm.tip_m - START - expected).max() < 0.03 * np.abs(expected).max()
    assert np.abs(arm.wrist_n - force).max() < 0.002  # the sensor reads the load, turned back to the base


def hold(arm: Arm, gains: np.ndarray, force: np.ndarray, steps: int, feed: float = 0.0) -> np.ndarray:
    errors = []
    for k in range(steps):
        goal = np.array(START) - [0.0, feed * k * 1e-3, 0.0]
        arm.step(goal, np.array([0.0, -feed, 0.0]), gains, force, np.zeros(3))
        errors.append(goal - arm.tip_m)
    return np.array(errors)


def test_controller_tracks_and_friction_costs_a_little() -> None:
    gains, none = np.array([2450.0, 2080.0, 530.0]), np.zeros(3)
    smooth = np.abs(hold(Arm(START, friction=0.0), gains, none, 3000, FEED)[1000:]).max()
    rough = np.abs(hold(Arm(START), gains, none, 3000, FEED)[1000:]).max()
    assert smooth < 3e-5
    assert 3e-5 < rough < 1e-3
    with pytest.raises(ValueError, match="cannot reach"):
        Arm((3.0, 0.0, 0.1))


# -- structure and sensor


def test_structure_rings_at_its_frequency_and_settles_on_its_spring() -> None:
    swing = Structure(RobotMode((30.0, 0.0), damping=0.02, mass_kg=10.0))
    course = []
    for _ in range(3000):
        swing.step(np.array([5.0, 5.0]))
        course.append(swing.shift_m.copy())
    x = np.array(course)[:, 0]
    assert np.all(np.array(course)[:, 1] == 0.0)
    assert x[-1] == pytest.approx(5.0 / (10.0 * (2 * np.pi * 30.0) ** 2), rel=0.01)
    line = np.abs(np.fft.rfft(x[:1000] - x[-1]))
    assert abs(int(np.argmax(line[1:])) + 1 - 30) <= 1


def gain(sensor: Sensor, hz: float) -> float:
    """Amplitude at the 500 Hz samples of a unit sine at the input."""
    time = (np.arange(8 * 2000) + 0.5) / 8000.0
    load = np.sin(2.0 * np.pi * hz * time)[:, None] * np.ones(3)
    heard = []
    for block in load.reshape(-1, 8, 3):
        sensor.feed(block)
        heard.append(sensor.filtered_n[0])
    return float(np.sqrt(2.0) * np.std(heard[1000:]))


def test_sensor_filters() -> None:
    none = SensorLowpass(), SensorResonance(), Drift()
    declared = 1.0 / np.sqrt(1.0 + (60.0 / 120.0) ** 8)
    assert gain(Sensor(8, *none), 60.0) == pytest.approx(declared, rel=0.02)
    low = gain(Sensor(8, SensorLowpass(order=2, hz=30.0), none[1], none[2]), 60.0)
    assert low == pytest.approx(declared / np.sqrt(1.0 + 2.0**4), rel=0.03)
    ringing = Sensor(8, none[0], SensorResonance(frequency_hz=60.0, damping=0.05), none[2])
    assert gain(ringing, 60.0) == pytest.approx(declared / (2 * 0.05), rel=0.05)


def test_sensor_drift_is_zeroed_and_noise_is_declared() -> None:
    sensor = Sensor(8, SensorLowpass(), SensorResonance(), Drift((4.0, 0.0, 0.0), tau_s=10.0))
    sensor.reset(5.0)
    heard = np.array([sensor.sample(1e9)[0] for _ in range(2000)])
    assert heard.mean() == pytest.approx(4.0 * np.exp(-0.5), abs=0.02)
    assert heard.std() == pytest.approx(NOISE_N[0], rel=0.1)


# -- configuration


def test_effects_file(tmp_path: Path) -> None:
    path = tmp_path / "hidden.toml"
    path.write_text("[radial_runout]\noffset_m = 1.2e-5\n[robot_mode]\nfrequency_hz = [30, 45.0]\n")
    hidden = load(path)
    assert hidden.radial_runout.offset_m == 1.2e-5 and hidden.robot_mode.frequency_hz == (30.0, 45.0)
    assert from_dict(to_dict(hidden)) == hidden
    assert to_dict(Hidden()) == {}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[runout]\n", "expected tables of radial_runout"),
        ("[wear]\nper_metre = 1\n", "expected per_m"),
        ("[radial_runout]\noffset_m = 0.3\n", "expected a number in 0 to 0.0001"),
        ("[radial_runout]\noffset_m = 'x'\n", "expected a number"),
        ("[drift]\nfinal_n = [1, 2]\n", "expected 3 numbers"),
        ("wear = 3\n", "expected tables"),
        ("[wear", "cannot be read as TOML"),
    ],
)
def test_bad_effects_file(text: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / "hidden.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=told):
        load(path)


# -- independence


def test_imports_nothing_of_ours_but_the_packets() -> None:
    allowed = ("mjx_cutting.deploy.protocol", "mjx_cutting.deploy.virtual_cell")
    for path in FOLDER.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            assert not (isinstance(node, ast.ImportFrom) and node.level), f"{path.name}: relative import"
            for name in names:
                ours = name.split(".")[0] == "mjx_cutting"
                assert not ours or name.startswith(allowed), f"{path.name} imports {name}"
    code = (
        "import sys, json, mjx_cutting.deploy.virtual_cell.process\n"
        "print(json.dumps([n for n in sys.modules if n.startswith(('mjx_cutting', 'jax'))]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True
    )
    loaded = json.loads(done.stdout)
    assert not [name for name in loaded if name.startswith("jax")]
    ours = {name.removeprefix("mjx_cutting.") for name in loaded if name.startswith("mjx_cutting.")}
    assert {name.split(".")[0] for name in ours} == {"deploy"}
    assert {name for name in ours if not name.startswith("deploy.virtual_cell")} <= {
        "deploy",
        "deploy.protocol",
    }


def spectrum(force: np.ndarray, hz: float) -> float:
    """Amplitude of the feed force's line at `hz`, over the last second."""
    wave = force[1000:2000, 0]
    return 2.0 * abs(np.mean(wave * np.exp(-2j * np.pi * hz * np.arange(1000) * 1e-3)))
