"""What a set of measured trials is: plain frozen records of NumPy arrays, in SI units and process axes.

The idea: one `Dataset` holds the tool, the sensor and the trials cut with them; a `Trial` holds its cutting
conditions and its record. Whatever the sensor's own axes were, `Trial.force_n` is in the process frame (x
feed, y normal to the feed in the cutting plane, z tool axis) and is the force ON THE TOOL; `Dataset.axes`
remembers how the file's columns map to it, so that writing gives the same columns back.

The assumption that breaks it: one tool geometry and one sensor a dataset. Trials with another cutter belong
in another dataset. Worn or changed tools of the same geometry are told apart by `Trial.tool_id`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
ToolKind = Literal["end_mill", "slitting_saw", "drill", "turning"]
TrialKind = Literal["cut", "air"]
Milling = Literal["slot", "conventional", "climb"]

TOOL_KINDS = ("end_mill", "slitting_saw", "drill", "turning")
TRIAL_KINDS = ("cut", "air")
MILLINGS = ("slot", "conventional", "climb")
ZEROINGS = ("trial", "session")
UNITS = ("SI", "arbitrary")
AXIS_NAMES = ("+x", "-x", "+y", "-y", "+z", "-z")
FILTER_KINDS = ("butterworth",)


def _one_of(name: str, value: object, allowed: Sequence[str]) -> None:
    if value not in allowed:
        raise ValueError(
            f"{name}: got {value!r}, expected one of {', '.join(map(repr, allowed))}; correct the value."
        )


def _number(name: str, value: object, *, above: float | None = None, least: float | None = None) -> None:
    expected = "a finite number"
    if above is not None:
        expected += f" greater than {above:g}"
    if least is not None:
        expected += f" not less than {least:g}"
    good = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    number = float(cast(float, value)) if good else float("nan")
    good = (
        bool(np.isfinite(number)) and (above is None or number > above) and (least is None or number >= least)
    )
    if not good:
        raise ValueError(f"{name}: got {value!r}, expected {expected}; correct the value (SI units).")


@dataclass(frozen=True)
class ToolInfo:
    """The cutter.

    kind; teeth: cutting edges [-] (>= 1); diameter_m [m] (> 0); helix_rad [rad] (between -pi/2 and pi/2).
    """

    kind: ToolKind
    teeth: int
    diameter_m: float
    helix_rad: float = 0.0

    def __post_init__(self) -> None:
        _one_of("tool.kind", self.kind, TOOL_KINDS)
        if isinstance(self.teeth, bool) or not isinstance(self.teeth, int | np.integer) or self.teeth < 1:
            raise ValueError(
                f"tool.teeth: got {self.teeth!r}, expected a whole number of at least 1; count the edges."
            )
        _number("tool.diameter_m", self.diameter_m, above=0.0)
        _number("tool.helix_rad", self.helix_rad)
        if abs(self.helix_rad) >= np.pi / 2:
            raise ValueError(
                f"tool.helix_rad: got {self.helix_rad!r}, expected radians between -pi/2 and pi/2; "
                "convert degrees to radians (45 deg is 0.7854)."
            )

    @property
    def measures_torque(self) -> bool:
        """True for drills, whose record is thrust and torque instead of three forces."""
        return self.kind == "drill"


@dataclass(frozen=True)
class AntiAlias:
    """The known filter before sampling: a Butterworth low-pass.

    order [-] (1 to 20), corner frequency hz [Hz] (> 0), zero_phase: run forwards and back.
    """

    kind: Literal["butterworth"] = "butterworth"
    order: int = 4
    hz: float = 200.0
    zero_phase: bool = False

    def __post_init__(self) -> None:
        _one_of("sensor.anti_alias.kind", self.kind, FILTER_KINDS)
        if (
            isinstance(self.order, bool)
            or not isinstance(self.order, int | np.integer)
            or not 1 <= self.order <= 20
        ):
            raise ValueError(
                f"sensor.anti_alias.order: got {self.order!r}, expected a whole number from 1 to 20; "
                "give the filter's order."
            )
        _number("sensor.anti_alias.hz", self.hz, above=0.0)
        if not isinstance(self.zero_phase, bool):
            raise ValueError(
                f"sensor.anti_alias.zero_phase: got {self.zero_phase!r}, expected true or false; correct it."
            )


@dataclass(frozen=True)
class Sensor:
    """The force sensor.

    sample_rate_hz [Hz] (> 0); noise_std_n: standard deviation of each process axis [N], or of a drill's
    thrust [N] and torque [N m], or None where unknown; zeroed: "trial" (bias taken anew before each trial) or
    "session" (one bias for all, drift shows); units: "SI" or "arbitrary" (uncalibrated); anti_alias: the
    known filter before sampling, or None.
    """

    sample_rate_hz: float
    noise_std_n: tuple[float, float, float] | tuple[float, float] | None = None
    zeroed: Literal["trial", "session"] = "trial"
    units: Literal["SI", "arbitrary"] = "SI"
    anti_alias: AntiAlias | None = None

    def __post_init__(self) -> None:
        _number("sensor.sample_rate_hz", self.sample_rate_hz, above=0.0)
        _one_of("sensor.zeroed", self.zeroed, ZEROINGS)
        _one_of("sensor.units", self.units, UNITS)
        if self.noise_std_n is not None:
            if isinstance(self.noise_std_n, str) or len(self.noise_std_n) not in (2, 3):
                raise ValueError(
                    f"sensor.noise_std_n: got {self.noise_std_n!r}, expected three numbers (two for a drill) "
                    "or null; give one a force column, in newtons (torque in newton metres)."
                )
            for index, value in enumerate(self.noise_std_n):
                _number(f"sensor.noise_std_n[{index}]", value, least=0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial:
    """One trial: its conditions and its record of T samples. Arrays are float64 and read-only.

    Conditions: kind "cut" or "air"; milling "slot", "conventional", "climb" or None (drill, turning);
    spindle_speed_rev_s [rev/s] (> 0); feed_speed_m_s [m/s]; radial_depth_m [m] (slot: the diameter);
    axial_width_m [m]; cut_length_before_m [m] cut with this tool before the trial began and clock_start_s [s]
    its start on the session's clock (both 0 where not given).

    Record: time_s [T]; force_n [T, 3] on the tool in process axes (drills: thrust in [:, 2], NaN in the two
    axes that are not measured); torque_nm [T] for drills; and, where measured, position_m [T, 3],
    spindle_angle_rad [T], spindle_speed_measured_rev_s [T], feed_speed_measured_m_s [T].
    """

    file: str
    kind: TrialKind
    milling: Milling | None
    spindle_speed_rev_s: float
    feed_speed_m_s: float
    radial_depth_m: float
    axial_width_m: float
    material: str | None = None
    tool_id: str | None = None
    cut_length_before_m: float = 0.0
    clock_start_s: float = 0.0
    time_s: Array
    force_n: Array
    torque_nm: Array | None = None
    position_m: Array | None = None
    spindle_angle_rad: Array | None = None
    spindle_speed_measured_rev_s: Array | None = None
    feed_speed_measured_m_s: Array | None = None

    def __post_init__(self) -> None:
        _one_of(f"{self.file}: kind", self.kind, TRIAL_KINDS)
        if self.milling is not None:
            _one_of(f"{self.file}: milling", self.milling, MILLINGS)
        _number(f"{self.file}: spindle_speed_rev_s", self.spindle_speed_rev_s, above=0.0)
        for name in ("feed_speed_m_s", "radial_depth_m", "axial_width_m", "cut_length_before_m"):
            _number(f"{self.file}: {name}", getattr(self, name), least=0.0)
        _number(f"{self.file}: clock_start_s", self.clock_start_s)
        samples = np.asarray(self.time_s).shape
        if len(samples) != 1:
            raise ValueError(
                f"{self.file}: time_s has shape {samples}, expected one axis [T]; pass a flat array."
            )
        shapes = {"force_n": (*samples, 3), "position_m": (*samples, 3)}
        for name in ("time_s", "force_n", *OPTIONAL_RECORDS):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, self._frozen(name, value, shapes.get(name, samples)))

    def _frozen(self, name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
        array = np.asarray(value, dtype=np.float64).view()
        if array.shape != shape:
            raise ValueError(
                f"{self.file}: {name} has shape {array.shape}, expected {shape}; "
                "give every record as many samples as time_s."
            )
        array.flags.writeable = False
        return array

    @property
    def samples(self) -> int:
        """Number of samples T."""
        return len(self.time_s)

    @property
    def revolutions(self) -> float:
        """Spindle revolutions the record covers at the nominal speed [-]."""
        return float(self.time_s[-1] - self.time_s[0]) * self.spindle_speed_rev_s

    @property
    def signals(self) -> Array:
        """What was measured, [T, C]: the three forces [N], or for drills thrust [N] and torque [N m]."""
        if self.torque_nm is None:
            return self.force_n
        return np.stack([self.force_n[:, 2], self.torque_nm], axis=-1)

    def columns(self, axes: Sequence[str] | None) -> list[tuple[str, Array]]:
        """Names and values [T] of the columns of force in the trial's file; `axes` as in `Dataset`."""
        if self.torque_nm is not None:
            return [("force_z_n", self.force_n[:, 2]), ("torque_z_nm", self.torque_nm)]
        force_n = process_to_columns(self.force_n, axes)
        return [(f"force_{name}_n", force_n[:, index]) for index, name in enumerate("xyz")]


OPTIONAL_RECORDS = (
    "torque_nm",
    "position_m",
    "spindle_angle_rad",
    "spindle_speed_measured_rev_s",
    "feed_speed_measured_m_s",
)


@dataclass(frozen=True)
class LeftOut:
    """A trial that was not used: its file and the reason, in words a user can act on."""

    file: str
    reason: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Dataset:
    """Trials of one tool and one sensor, with where they come from, what was left out and what is doubtful.

    axes: the process axis of each force column of the files, as ("+y", "+x", "-z"), or None where the columns
    are process axes. The arrays of the trials are in process axes already; axes serve writing and provenance
    only.
    """

    name: str
    source: str | None = None
    licence: str | None = None
    tool: ToolInfo
    sensor: Sensor
    axes: tuple[str, str, str] | None = None
    trials: tuple[Trial, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.axes is not None:
            check_axes(self.axes)
        noise = self.sensor.noise_std_n
        if noise is not None and len(noise) == 2 and not self.tool.measures_torque:
            raise ValueError(
                f"sensor.noise_std_n: got {noise!r}, expected three numbers for tool.kind "
                f"{self.tool.kind!r}; give newtons, one a force column."
            )
        files = [trial.file for trial in self.trials]
        twice = (
            sorted({file for file in files if files.count(file) > 1}) if len(set(files)) < len(files) else []
        )
        if twice:
            raise ValueError(
                f"trials: got {', '.join(twice)} twice, expected each file once; rename or remove one."
            )


def check_axes(axes: Sequence[str]) -> None:
    """Raises ValueError unless axes are three signed names in which x, y and z each stand once."""
    good = (
        not isinstance(axes, str)
        and len(axes) == 3
        and all(isinstance(a, str) and a in AXIS_NAMES for a in axes)
    )
    if not good or {axis[1] for axis in axes} != {"x", "y", "z"}:
        raise ValueError(
            f"axes: got {list(axes)!r}, expected three of {', '.join(AXIS_NAMES)} with x, y and z once "
            'each, such as ["+y", "+x", "-z"]: the process axis that each force column measures; '
            "set null where the columns are process axes."
        )


def columns_to_process(columns: Array, axes: Sequence[str] | None) -> Array:
    """Forces in process axes [..., 3] from the sensor's columns [..., 3].

    process[..., axis of column i] = sign of column i * columns[..., i]; axes None: nothing to map.
    """
    if axes is None:
        return columns
    check_axes(axes)
    process = np.empty_like(columns)
    for column, axis in enumerate(axes):
        process[..., "xyz".index(axis[1])] = columns[..., column] if axis[0] == "+" else -columns[..., column]
    return process


def process_to_columns(process: Array, axes: Sequence[str] | None) -> Array:
    """The sensor's columns [..., 3] from forces in process axes [..., 3]: undoes `columns_to_process`."""
    if axes is None:
        return process
    check_axes(axes)
    columns = np.empty_like(process)
    for column, axis in enumerate(axes):
        value = process[..., "xyz".index(axis[1])]
        columns[..., column] = value if axis[0] == "+" else -value
    return columns
