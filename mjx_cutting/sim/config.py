"""Every number of the simulation, with its unit and the reason for its default.

Where the paper (Hathaway et al., IROS 2024; T-ASE 2023) states a value it is used; where it is silent the
default is ours and says so. Axes are those of the robot's base: x transverse, y against the feed, z up.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from typing import Any

from mjx_cutting.sim.materials import MATERIALS

ENGINES = ("fused", "mjx")
DISTURBANCES = ("none", "observation", "dynamics")
DRAWS = ("new_trial", "function", "mean", "function_noise")
MODEL_MATERIAL = "model"
MAX_DEPTH_M = 0.006
"""Deepest arc of the base model's closed form (`force.py`), m."""


@dataclass(frozen=True)
class EnvConfig:
    """Configuration of `CuttingEnv`; checked when it is made.

    Raises:
        ValueError: a value out of range, with what was expected.
    """

    engine: str = "fused"
    """"fused": our serial-chain formulation; "mjx": the stages of MuJoCo MJX, the reference."""

    # -- time
    policy_rate_hz: float = 50.0
    """Rate of actions, Hz. Paper."""
    physics_rate_hz: float = 500.0
    """Rate of physics, control and sensor, Hz, a multiple of the policy's. The paper's sensor rate."""
    max_episode_s: float = 60.0
    """Longest episode, s; then it is truncated. Ours: the paper's slowest policy takes 47.6 s."""

    # -- path and sheet
    approach_m: float = 0.030
    """Path in air before the sheet, m. Ours: 250 mm of path at 12.5 mm/s are the paper's 20 s."""
    cut_m: float = 0.220
    """Path over the sheet, m. Ours, see `approach_m`."""
    cell_m: float = 0.001
    """Cell of the height field along the path, m. Ours: a seventh of the chord of a 1 mm deep cut."""
    nominal_feed_m_s: float = 0.0125
    """Nominal feed v_n, m/s. Paper: 0.75 m/min."""
    start_m: tuple[float, float] = (0.52, 0.30)
    """x, y of the path's start, m. Ours: a feed force lifts the saw least there (mobility yz .004-.013)."""
    surface_height_m: float = 0.110
    """Height of the sheet's surface in the base frame, m. Ours: the working pose of the paper's group."""

    # -- saw
    teeth: int = 20
    """Teeth of the saw. Ours: small arbor saw."""
    diameter_m: float = 0.050
    """Diameter of the saw, m. Ours: small arbor saw."""
    kerf_m: float = 0.0016
    """Width of cut, m. Ours: foam's volume in the paper needs kerf x length of at least 331 mm^2."""
    spindle_speed_rev_s: float = 19.0
    """Spindle speed, rev/s. Ours: tooth passing (380 Hz) then aliases to 120 Hz and 20 Hz, never to 0."""
    force_samples: int = 8
    """Tool angles per physics step for models with effects (the base model is integrated exactly)."""

    # -- set-points: the action
    stiffness_s2: tuple[float, float] = (50.0, 3000.0)
    """Range of the position gains K_p, s^-2, log scale. Ours: spans what the paper's table implies."""
    feed_adjustment: tuple[float, float] = (-0.8, 1.0)
    """Range of v / v_n - 1. Ours: re-trained policies ran at .45, DAgger at 1.97 times nominal."""
    depth_m: tuple[float, float] = (0.0, 0.002)
    """Range of the depth of cut, m. Ours: twice the baseline."""
    stiffness_rate_s: float = 4.1
    """Largest |d ln K_p / dt|, 1/s. Ours: the whole range in a second."""
    feed_rate_s: float = 2.0
    """Largest rate of the feed adjustment, 1/s. Ours: 25 mm/s^2."""
    depth_rate_m_s: float = 0.002
    """Largest rate of the depth, m/s. Ours: the whole range in a second."""
    start_stiffness_s2: tuple[float, float, float] = (2450.0, 2080.0, 530.0)
    """Gains at reset, s^-2. The baseline's: 4, 4 and 5 N/mm, inside the 2.4 to 5.1 of the paper's table."""
    baseline_depth_m: float = 0.001
    """Depth of the baseline, m. Paper."""

    # -- controller
    orientation_stiffness_s2: float = 1000.0
    """Gain of the held orientation, s^-2. Ours: as stiff as 500 Hz allows without ringing."""
    null_damping_s: float = 10.0
    """Damping of the redundant joint, 1/s. Ours."""

    # -- sensor
    force_average_samples: int = 10
    """Force samples averaged into one observation. Ours: all samples of a policy step."""
    force_noise_n: tuple[float, float, float] = (0.10, 0.10, 0.18)
    """Standard deviation of one sample's noise, base axes, N. ATI Axia80: at most .25 and .45 N (z)."""
    force_range_n: tuple[float, float, float] = (500.0, 500.0, 900.0)
    """Saturation of the sensor, N. ATI Axia80-M20."""
    force_lowpass_hz: float = 120.0
    """First-order low-pass of the sensor, Hz; 0 switches it off. Ours: the Axia80's own default filter."""

    # -- what happens
    materials: tuple[str, ...] = tuple(MATERIALS)
    """Sheets drawn from at reset; "model" stands for the constants of the model given."""
    disturbance_mode: str = "none"
    """"none", "observation" (the force observed only) or "dynamics" (robot and reward too)."""
    disturbance_draw: str = "new_trial"
    """How `PeriodicPosterior.draw` draws: "new_trial", "function", "mean" or "function_noise"."""
    disturbance_in_air: bool = False
    """Whether the disturbance acts without contact too. Ours: it is learned from cutting."""
    randomize: bool = True
    """Draw pose, bias, gain and payload errors (below) at each reset; materials are drawn always."""
    sheet_height_std_m: float = 2e-5
    """Error of the sheet's height, m, normal. Ours: more would drown the paper's 10 mm^3 rows."""
    sheet_slope_std: float = 1e-4
    """Error of the sheet's slope along the feed, normal. Ours: 22 um over the cut."""
    sensor_bias_std_n: float = 0.2
    """Bias of each force axis, N, normal. Ours: drift after zeroing."""
    gain_error: float = 0.05
    """Relative error of the stiffness realised, uniform +-. Ours."""
    payload_error_kg: float = 0.02
    """Error of the saw's mass, kg, uniform +-. Ours: 1 % of it; at K_p = 80 s^-2 that moves the saw .3 mm."""

    # -- reward, per policy step
    reward_mrv_per_mm3: float = 1e-3
    """Q_mrv, per mm^3. Ours: on the paper's own table the four weights give its order of policies."""
    reward_time_per_s: float = 0.05
    """Q_cut, per s. Ours, see `reward_mrv_per_mm3`."""
    reward_path_per_mm2_s: tuple[float, float, float] = (1e-4, 1e-4, 1e-4)
    """Diagonal of Q_d, per mm^2 s. Ours, see `reward_mrv_per_mm3`."""
    reward_force_per_n2_s: tuple[float, float, float] = (5e-5, 5e-5, 5e-5)
    """Diagonal of Q_f, per N^2 s. Ours, see `reward_mrv_per_mm3`."""

    # -- termination
    failure_reward: float = -5.0
    """Added once on failure. Ours: worse than finishing anyhow, so that failing is never a way out."""
    max_deviation_m: float = 0.15
    """Path error that ends the episode as failed, m. Ours: a full load at the lowest gain stays below."""
    max_depth_m: float = 0.006
    """Depth of engagement that ends the episode as failed, m: drawn in. Ours: the force law's deepest arc."""
    max_force_n: float = 250.0
    """Force that ends the episode as failed, N. Ours: half the sensor's range."""

    def __post_init__(self) -> None:
        _check(self)

    @property
    def substeps(self) -> int:
        """Physics steps in one policy step."""
        return round(self.physics_rate_hz / self.policy_rate_hz)

    @property
    def physics_step_s(self) -> float:
        """Length of one physics step, s."""
        return 1.0 / self.physics_rate_hz

    @property
    def policy_step_s(self) -> float:
        """Length of one policy step, s."""
        return 1.0 / self.policy_rate_hz

    @property
    def path_m(self) -> float:
        """Length of the path, m."""
        return self.approach_m + self.cut_m

    @property
    def radius_m(self) -> float:
        """Radius of the saw, m."""
        return 0.5 * self.diameter_m

    @property
    def max_episode_steps(self) -> int:
        """Policy steps after which an episode is truncated."""
        return math.ceil(self.max_episode_s * self.policy_rate_hz)

    def to_dict(self) -> dict[str, Any]:
        """A plain dictionary, ready for config.json."""
        return asdict(self)


def _check(c: EnvConfig) -> None:
    _one_of("engine", c.engine, ENGINES)
    _one_of("disturbance_mode", c.disturbance_mode, DISTURBANCES)
    _one_of("disturbance_draw", c.disturbance_draw, DRAWS)
    for name, low, high, unit in _BOUNDS:
        value = getattr(c, name)
        for one in value if isinstance(value, tuple) else (value,):
            if not (isinstance(one, int | float) and low <= one <= high):
                raise ValueError(f"{name} is {value!r}; expected {low:g} to {high:g} {unit}".rstrip())
    for name in ("stiffness_s2", "feed_adjustment", "depth_m"):
        low, high = getattr(c, name)
        if not low < high:
            raise ValueError(f"{name} is {(low, high)}; expected (low, high) with low < high")
    for name, count in _LENGTHS.items():
        if len(getattr(c, name)) != count:
            raise ValueError(f"{name} has {len(getattr(c, name))} entries; expected {count}")
    ratio = c.physics_rate_hz / c.policy_rate_hz
    if abs(ratio - round(ratio)) > 1e-9 or ratio < 1:
        raise ValueError(
            f"physics_rate_hz is {c.physics_rate_hz:g} and policy_rate_hz {c.policy_rate_hz:g}; expected a "
            "whole number of physics steps in a policy step, such as 500 and 50"
        )
    if not 1 <= c.force_average_samples <= round(ratio):
        raise ValueError(
            f"force_average_samples is {c.force_average_samples}; expected 1 to {round(ratio)}, the force "
            "samples in one policy step"
        )
    for name in ("approach_m", "cut_m"):
        cells = getattr(c, name) / c.cell_m
        if abs(cells - round(cells)) > 1e-6:
            raise ValueError(f"{name} is {getattr(c, name)} m; expected a multiple of cell_m ({c.cell_m} m)")
    low, high = c.stiffness_s2
    if not all(low <= k <= high for k in c.start_stiffness_s2):
        raise ValueError(
            f"start_stiffness_s2 is {c.start_stiffness_s2}; expected gains in {low:g} to {high:g}"
        )
    if not c.depth_m[0] <= c.baseline_depth_m <= c.depth_m[1]:
        raise ValueError(f"baseline_depth_m is {c.baseline_depth_m}; expected it inside depth_m {c.depth_m}")
    if not c.materials:
        raise ValueError(
            "materials is empty; expected at least one of " + ", ".join((*MATERIALS, MODEL_MATERIAL))
        )
    for name in c.materials:
        _one_of("materials", name, (*MATERIALS, MODEL_MATERIAL))


def _one_of(name: str, value: Any, allowed: Iterable[str]) -> None:
    allowed = tuple(allowed)
    if value not in allowed:
        raise ValueError(f"{name} is {value!r}; expected one of {', '.join(allowed)}")


_LENGTHS = {
    "start_m": 2, "stiffness_s2": 2, "feed_adjustment": 2, "depth_m": 2, "start_stiffness_s2": 3,
    "force_noise_n": 3, "force_range_n": 3, "reward_path_per_mm2_s": 3, "reward_force_per_n2_s": 3,
}  # fmt: skip

_BOUNDS = (
    ("policy_rate_hz", 1.0, 500.0, "Hz"),
    ("physics_rate_hz", 200.0, 10000.0, "Hz (below, the stiffest gains ring)"),
    ("max_episode_s", 0.1, 3600.0, "s"),
    ("approach_m", 0.0, 0.2, "m"),
    ("cut_m", 0.01, 0.5, "m"),
    ("cell_m", 2e-4, 2e-3, "m"),
    ("nominal_feed_m_s", 1e-3, 0.1, "m/s"),
    ("surface_height_m", -0.2, 0.5, "m"),
    ("teeth", 1, 200, ""),
    ("diameter_m", 0.02, 0.2, "m (50 mm is 0.05)"),
    ("kerf_m", 1e-4, 0.02, "m (1.6 mm is 0.0016)"),
    ("spindle_speed_rev_s", 0.1, 1000.0, "rev/s (1140 rpm is 19)"),
    ("force_samples", 1, 256, ""),
    ("stiffness_s2", 1.0, 5000.0, "s^-2"),
    ("feed_adjustment", -1.0, 4.0, ""),
    ("depth_m", 0.0, 0.005, "m (1 mm is 0.001)"),
    ("stiffness_rate_s", 0.01, 1e3, "1/s"),
    ("feed_rate_s", 0.01, 1e3, "1/s"),
    ("depth_rate_m_s", 1e-5, 1.0, "m/s"),
    ("orientation_stiffness_s2", 1.0, 5000.0, "s^-2"),
    ("null_damping_s", 0.0, 100.0, "1/s"),
    ("force_noise_n", 0.0, 50.0, "N"),
    ("force_range_n", 1.0, 1e5, "N"),
    ("force_lowpass_hz", 0.0, 1e4, "Hz"),
    ("sheet_height_std_m", 0.0, 2e-3, "m"),
    ("sheet_slope_std", 0.0, 0.02, ""),
    ("sensor_bias_std_n", 0.0, 50.0, "N"),
    ("gain_error", 0.0, 0.5, ""),
    ("payload_error_kg", 0.0, 1.0, "kg"),
    ("reward_mrv_per_mm3", 0.0, 1e3, "per mm^3"),
    ("reward_time_per_s", 0.0, 1e3, "per s"),
    ("reward_path_per_mm2_s", 0.0, 1e3, "per mm^2 s"),
    ("reward_force_per_n2_s", 0.0, 1e3, "per N^2 s"),
    ("failure_reward", -1e4, 0.0, ""),
    ("max_deviation_m", 1e-3, 1.0, "m"),
    ("max_depth_m", 1e-4, MAX_DEPTH_M, "m (the force of deeper arcs is not modelled)"),
    ("max_force_n", 1.0, 1e4, "N"),
)


def field_names() -> tuple[str, ...]:
    """Names of all fields, in order."""
    return tuple(field.name for field in fields(EnvConfig))
