"""What the cell does that nobody has been told: effects, each off unless the TOML file has its table.

    [radial_runout]
    offset_m = 1.2e-5

Every table and key is a field below; `load` refuses others, and values outside their range.
"""

from __future__ import annotations

import dataclasses
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class RadialRunout:
    """The saw turns about another axis than its teeth's: offset, m, and its direction from tooth 0, rad."""

    offset_m: float = 0.0
    angle_rad: float = 0.0


@dataclass(frozen=True)
class UnequalPitch:
    """Deviation of each tooth's gap to the one before it, rad; the mean is taken off."""

    error_rad: tuple[float, ...] = ()


@dataclass(frozen=True)
class Wear:
    """Relative growth of the tangential edge constant per metre cut, 1/m; the radial one grows `radial_ratio`
    times as fast. It lasts over the session."""

    per_m: float = 0.0
    radial_ratio: float = 2.0


@dataclass(frozen=True)
class RobotMode:
    """One mode of the structure along feed and normal: frequencies, Hz, damping ratio, modal mass, kg, and
    the mass that the wrist sensor carries with it, kg."""

    frequency_hz: tuple[float, float] = (0.0, 0.0)
    damping: float = 0.05
    mass_kg: float = 10.0
    sensed_kg: float = 2.2


@dataclass(frozen=True)
class SensorLowpass:
    """A Butterworth low-pass that nobody declared: order 1 to 4 and corner, Hz."""

    order: int = 2
    hz: float = 0.0


@dataclass(frozen=True)
class SensorResonance:
    """The transducer's own resonance: frequency, Hz, and damping ratio."""

    frequency_hz: float = 0.0
    damping: float = 0.05


@dataclass(frozen=True)
class Drift:
    """Bias of the sensor, N, that builds up with time constant tau, s, from the start of the session."""

    final_n: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tau_s: float = 600.0


@dataclass(frozen=True)
class MaterialPeriodicity:
    """The sheet resists 1 + amplitude cos(2 pi s / wavelength + phase) times as much, chip and edge alike."""

    amplitude: float = 0.0
    wavelength_m: float = 5e-3
    phase_rad: float = 0.0


@dataclass(frozen=True)
class SheetPose:
    """Where the sheet's top really is: height above nominal, m, and slope along the path."""

    height_m: float = 0.0
    slope: float = 0.0


@dataclass(frozen=True)
class Resistance:
    """Factors on the sheet's constants: another batch of the material."""

    chip: float = 1.0
    edge: float = 1.0


@dataclass(frozen=True)
class Network:
    """Share of packets lost, and delay of each, uniform up to `jitter_s`; both directions."""

    loss: float = 0.0
    jitter_s: float = 0.0


@dataclass(frozen=True)
class Hidden:
    """All effects; the default is none of them."""

    radial_runout: RadialRunout = field(default_factory=RadialRunout)
    unequal_pitch: UnequalPitch = field(default_factory=UnequalPitch)
    wear: Wear = field(default_factory=Wear)
    robot_mode: RobotMode = field(default_factory=RobotMode)
    sensor_lowpass: SensorLowpass = field(default_factory=SensorLowpass)
    sensor_resonance: SensorResonance = field(default_factory=SensorResonance)
    drift: Drift = field(default_factory=Drift)
    material_periodicity: MaterialPeriodicity = field(default_factory=MaterialPeriodicity)
    sheet_pose: SheetPose = field(default_factory=SheetPose)
    resistance: Resistance = field(default_factory=Resistance)
    network: Network = field(default_factory=Network)


BOUNDS = {
    "radial_runout.offset_m": (0.0, 1e-4), "radial_runout.angle_rad": (-7.0, 7.0),
    "unequal_pitch.error_rad": (-0.1, 0.1), "wear.per_m": (0.0, 10.0), "wear.radial_ratio": (0.0, 10.0),
    "robot_mode.frequency_hz": (0.0, 250.0), "robot_mode.damping": (1e-3, 1.0),
    "robot_mode.mass_kg": (0.1, 1e3), "robot_mode.sensed_kg": (0.0, 10.0), "sensor_lowpass.order": (1, 4),
    "sensor_lowpass.hz": (0.0, 3000.0), "sensor_resonance.frequency_hz": (0.0, 3000.0),
    "sensor_resonance.damping": (1e-3, 2.0), "drift.final_n": (-50.0, 50.0), "drift.tau_s": (1e-3, 1e6),
    "material_periodicity.amplitude": (0.0, 1.0), "material_periodicity.wavelength_m": (5e-4, 1.0),
    "material_periodicity.phase_rad": (-7.0, 7.0), "sheet_pose.height_m": (-2e-3, 2e-3),
    "sheet_pose.slope": (-0.02, 0.02), "resistance.chip": (0.01, 100.0), "resistance.edge": (0.01, 100.0),
    "network.loss": (0.0, 1.0), "network.jitter_s": (0.0, 1.0),
}  # fmt: skip


def load(path: str | Path) -> Hidden:
    """The effects of a TOML file.

    Raises:
        ValueError: no such file, no TOML, an unknown table or key, or a value of the wrong kind or range.
    """
    path = Path(path)
    try:
        return from_dict(tomllib.loads(path.read_text()))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ValueError(
            f"got {path} that cannot be read as TOML ({error}); expected tables such as [radial_runout]"
        ) from error


def from_dict(tables: dict[str, Any]) -> Hidden:
    """The effects of a dictionary of tables; raises ValueError as `load` does."""
    kinds = {each.name: each.default_factory for each in dataclasses.fields(Hidden)}
    found = {}
    for name, table in tables.items():
        if name not in kinds or not isinstance(table, dict):
            raise ValueError(f"got the table {name!r}; expected tables of {', '.join(kinds)}")
        plain: Any = kinds[name]()  # type: ignore[operator]
        unknown = set(table) - {each.name for each in dataclasses.fields(plain)}
        if unknown:
            known = ", ".join(each.name for each in dataclasses.fields(plain))
            raise ValueError(f"got {name}.{sorted(unknown)[0]}; expected {known}")
        found[name] = dataclasses.replace(
            plain, **{k: _value(f"{name}.{k}", v, getattr(plain, k)) for k, v in table.items()}
        )
    return Hidden(**found)


def to_dict(hidden: Hidden) -> dict[str, Any]:
    """The tables that differ from none, as `from_dict` reads them."""
    plain = Hidden()
    return {
        each.name: dataclasses.asdict(getattr(hidden, each.name))
        for each in dataclasses.fields(hidden)
        if getattr(hidden, each.name) != getattr(plain, each.name)
    }


def _value(name: str, value: Any, default: Any) -> Any:
    low, high = BOUNDS[name]
    several = isinstance(default, tuple)
    values = value if isinstance(value, list | tuple) else (value,)
    wrong = any(isinstance(v, bool) or not isinstance(v, int | float) or not low <= v <= high for v in values)
    if (
        wrong
        or several != isinstance(value, list | tuple)
        or (default and several and len(values) != len(default))
    ):
        count = f"{len(default) or 'a list of'} numbers" if several else "a number"
        raise ValueError(f"got {name} = {value!r}; expected {count} in {low:g} to {high:g}")
    return tuple(float(v) for v in values) if several else type(default)(value)
