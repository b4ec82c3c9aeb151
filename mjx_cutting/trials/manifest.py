"""`dataset.json` as a checked description: what the folder's author declared, before any record is read.

The idea: a fault in the document itself (not JSON, another format, a missing section, a wrong type) is a
ValueError that names the key path; a fault in one trial's entry leaves out that trial alone, with the reason.

The assumption that breaks it: values are SI. A number in other units is a good number here; `checks` catches
the implausible ones.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mjx_cutting.trials.dataset import (
    MILLINGS,
    TOOL_KINDS,
    TRIAL_KINDS,
    UNITS,
    ZEROINGS,
    AntiAlias,
    Dataset,
    LeftOut,
    Sensor,
    ToolInfo,
    check_axes,
)
from mjx_cutting.trials.keys import Keys, shown

FORMAT = "mjx-cutting-trials/1"
LARGEST_DIAMETER_M = 1.0
"""A cutter larger than this is taken for millimetres given as metres."""


@dataclass(frozen=True)
class Entry:
    """One trial as declared: its file, the keyword arguments of `Trial` that are not records, which optional
    keys were given.
    """

    file: str
    conditions: dict[str, Any]
    given: frozenset[str]


@dataclass(frozen=True)
class Manifest:
    """A whole `dataset.json`; entries in their order, and the entries that cannot be used with their
    reasons.
    """

    name: str
    source: str | None
    licence: str | None
    tool: ToolInfo
    sensor: Sensor
    axes: tuple[str, str, str] | None
    entries: tuple[Entry, ...]
    left_out: tuple[LeftOut, ...]
    warnings: tuple[str, ...]

    def without_trials(self) -> Dataset:
        """The dataset declared here, before any trial is read."""
        return Dataset(
            name=self.name,
            source=self.source,
            licence=self.licence,
            tool=self.tool,
            sensor=self.sensor,
            axes=self.axes,
            left_out=self.left_out,
            warnings=self.warnings,
        )


def read_manifest(folder: Path) -> Manifest:
    """The manifest of a dataset folder.

    Raises ValueError where the folder or its `dataset.json` is missing, is not JSON, or breaks the format.
    """
    path = folder / "dataset.json"
    if not path.is_file():
        state = (
            "has no dataset.json"
            if folder.is_dir()
            else "is not a folder"
            if folder.exists()
            else "does not exist"
        )
        raise ValueError(
            f"{folder}: got a path that {state}, expected a dataset folder; give the folder that holds "
            "dataset.json, "
            "or make one with `mjx-cutting data import`."
        )
    try:
        document = json.loads(path.read_text(encoding="utf-8-sig"))
    except UnicodeDecodeError as error:
        raise ValueError(
            f"{path}: got bytes that are not UTF-8 ({error}), expected JSON text; save it as UTF-8."
        ) from None
    except json.JSONDecodeError as error:
        raise ValueError(
            f"{path}: got text that is not JSON (line {error.lineno}, column {error.colno}: {error.msg}), "
            "expected one JSON object; mend that line."
        ) from None
    try:
        return parse_manifest(document, name=folder.resolve().name)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def parse_manifest(document: Any, *, name: str) -> Manifest:
    """The manifest in a parsed document; `name` serves where the document gives none. Raises ValueError with
    the key path.
    """
    if not isinstance(document, dict):
        raise ValueError(
            f"got {shown(document)} at the top, expected an object {{ ... }}; see docs/dataset.md."
        )
    top = Keys(document, "")
    if top.absent("format") or document["format"] != FORMAT:
        raise top.fault(
            "format", f'"{FORMAT}"', "this version reads no other; convert the dataset or correct the string"
        )
    tool_keys = top.section("tool")
    tool = parse_tool(tool_keys)
    sensor_keys = top.section("sensor")
    axes = parse_axes(top)
    if tool.measures_torque and axes is not None and axes[2][1] != "z":
        raise top.fault("axes", "the third (thrust) to be +z or -z for a drill", "correct it or set null")
    sensor, warnings = parse_sensor(sensor_keys, axes, tool.measures_torque)
    warnings = tool_keys.unknown() + warnings
    rows = None if top.absent("trials") else document["trials"]
    if not isinstance(rows, list) or not rows:
        raise top.fault(
            "trials", "a list with at least one trial", "list each file with its cutting conditions"
        )
    entries: list[Entry] = []
    left_out: list[LeftOut] = []
    seen: set[str] = set()
    for index, row in enumerate(rows):
        if not isinstance(row, dict):
            raise ValueError(
                f"trials[{index}]: got {shown(row)}, expected an object {{ ... }}; see docs/dataset.md."
            )
        keys = Keys(row, f"trials[{index}]")
        file = keys.text("file")
        if not file:
            raise keys.fault(
                "file", "the name of a CSV or Parquet file in this folder", "name the trial's file"
            )
        if file in seen:
            reason = f"trials[{index}].file: got this file again, expected each file once; remove one entry."
            left_out.append(LeftOut(file, reason))
            continue
        seen.add(file)
        try:
            entries.append(parse_entry(keys, file, tool))
        except ValueError as error:
            left_out.append(LeftOut(file, str(error)))
        else:
            warnings += keys.unknown()
    warnings += _given_for_some([entry for entry in entries if entry.conditions["kind"] == "cut"])
    name = top.text("name", default=name) or name
    source, licence = top.text("source"), top.text("licence")
    warnings = top.unknown() + warnings
    return Manifest(
        name, source, licence, tool, sensor, axes, tuple(entries), tuple(left_out), tuple(warnings)
    )


def parse_tool(keys: Keys) -> ToolInfo:
    """The tool section."""
    kind = keys.choice("kind", TOOL_KINDS)
    diameter_m = keys.number("diameter_m", above=0.0)
    if diameter_m > LARGEST_DIAMETER_M:
        raise keys.fault(
            "diameter_m", f"metres, at most {LARGEST_DIAMETER_M:g}", "divide millimetres by 1000"
        )
    helix_rad = 0.0 if keys.absent("helix_rad") else keys.number("helix_rad")
    if abs(helix_rad) >= np.pi / 2:
        raise keys.fault(
            "helix_rad", "radians between -pi/2 and pi/2", "multiply degrees by pi/180 (45 deg is 0.7854)"
        )
    return ToolInfo(kind, keys.whole("teeth", least=1), diameter_m, helix_rad)  # type: ignore[arg-type]


def parse_axes(top: Keys) -> tuple[str, str, str] | None:
    """The axes mapping: process axis of each force column, or None."""
    if top.absent("axes"):
        return None
    axes = top.table["axes"]
    if not isinstance(axes, list):
        raise top.fault(
            "axes", 'a list such as ["+y", "+x", "-z"] or null', "give the process axis of each force column"
        )
    check_axes(axes)
    return axes[0], axes[1], axes[2]


def _noise(
    keys: Keys, axes: tuple[str, str, str] | None, torque: bool
) -> tuple[float, float, float] | tuple[float, float]:
    given = keys.table["noise_std_n"]
    good = isinstance(given, list) and len(given) in ((2, 3) if torque else (3,))
    if not good or any(
        isinstance(v, bool) or not isinstance(v, int | float) or not 0 <= v < np.inf for v in given
    ):
        count = "two or three" if torque else "three"
        units = "newtons and newton metres" if torque else "newtons"
        raise keys.fault(
            "noise_std_n", f"{count} numbers not less than 0, or null", f"give {units}, one a force column"
        )
    if len(given) == 2:
        return float(given[0]), float(given[1])
    placed = dict(zip((axis[1] for axis in axes) if axes else "xyz", map(float, given), strict=True))
    return placed["x"], placed["y"], placed["z"]


def parse_sensor(
    keys: Keys, axes: tuple[str, str, str] | None, torque: bool = False
) -> tuple[Sensor, list[str]]:
    """The sensor section and its warnings; noise_std_n, given by force column, is put in process axes.

    With `torque` two numbers will do, those of thrust and torque, in the order of the columns.
    """
    rate_hz = keys.number("sample_rate_hz", above=0.0)
    noise = None if keys.absent("noise_std_n") else _noise(keys, axes, torque)
    warnings: list[str] = []
    anti_alias = None
    if not keys.absent("anti_alias"):
        inner = keys.section("anti_alias")
        anti_alias = AntiAlias(
            kind=inner.choice("kind", ("butterworth",)),  # type: ignore[arg-type]
            order=inner.whole("order", least=1),
            hz=inner.number("hz", above=0.0),
            zero_phase=inner.flag("zero_phase", default=False),
        )
        warnings += inner.unknown()
        if anti_alias.hz >= rate_hz / 2:
            warnings.append(
                f"{inner.where('hz')}: got {anti_alias.hz:g} Hz, expected less than half the sampling rate "
                f"({rate_hz / 2:g} Hz); such a filter does not prevent aliasing. Check both numbers."
            )
    sensor = Sensor(
        sample_rate_hz=rate_hz,
        noise_std_n=noise,
        zeroed=keys.choice("zeroed", ZEROINGS, default="trial"),  # type: ignore[arg-type]
        units=keys.choice("units", UNITS, default="SI"),  # type: ignore[arg-type]
        anti_alias=anti_alias,
    )
    return sensor, keys.unknown() + warnings


def parse_entry(keys: Keys, file: str, tool: ToolInfo) -> Entry:
    """One trial's conditions; raises ValueError with the key path where one is missing or out of range."""
    kind = keys.choice("kind", TRIAL_KINDS)
    cutting = kind == "cut"
    conditions: dict[str, Any] = {"kind": kind, "milling": None}
    if tool.kind in ("end_mill", "slitting_saw"):
        conditions["milling"] = keys.choice("milling", MILLINGS)
    else:
        keys.absent("milling")
    conditions["spindle_speed_rev_s"] = keys.number("spindle_speed_rev_s", above=0.0)
    conditions["feed_speed_m_s"] = _positive_when_cutting(keys, "feed_speed_m_s", cutting)
    for key, other in (_SIZES, _SIZES[::-1]):
        if keys.absent(key) and (told := _size(keys, other, tool, cutting)) is not None:
            conditions[key] = told
        else:
            conditions[key] = _positive_when_cutting(keys, key, cutting)
    conditions["material"] = keys.text("material")
    conditions["tool_id"] = keys.text("tool_id")
    conditions["cut_length_before_m"] = (
        0.0 if keys.absent("cut_length_before_m") else keys.number("cut_length_before_m", least=0.0)
    )
    conditions["clock_start_s"] = 0.0 if keys.absent("clock_start_s") else keys.number("clock_start_s")
    return Entry(file, conditions, frozenset(key for key in HISTORY if not keys.absent(key)))


HISTORY = ("cut_length_before_m", "clock_start_s", "tool_id")
"""Optional keys that tell a trial's place in the session: useful only when every cut has them."""


_SIZES = ("radial_depth_m", "axial_width_m")


def _size(keys: Keys, other: str, tool: ToolInfo, cutting: bool) -> float | None:
    """Depth or width, m, where it is not given and the rest of the entry leaves no doubt: of a drill the
    tool's, in air none, on a lathe that of the `other` key; None elsewhere."""
    if tool.kind == "drill":
        return tool.diameter_m / 2
    if not cutting:
        return 0.0
    if tool.kind == "turning" and not keys.absent(other):
        return keys.number(other, above=0.0)
    return None


def _positive_when_cutting(keys: Keys, key: str, cutting: bool) -> float:
    return keys.number(key, above=0.0) if cutting else keys.number(key, least=0.0)


def _given_for_some(entries: list[Entry]) -> list[str]:
    warnings = []
    for key in HISTORY:
        without = [entry.file for entry in entries if key not in entry.given]
        if without and len(without) < len(entries):
            warnings.append(
                f"trials: {key} is missing for "
                f"{', '.join(without[:5])}{' and others' if len(without) > 5 else ''} and given "
                f"for the rest; {'taken as unknown' if key == 'tool_id' else 'taken as 0'} there. Give it "
                "for every trial."
            )
    return warnings
