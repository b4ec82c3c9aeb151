"""The conditions of recordings that do not carry them: a side file in TOML or JSON, or the files' names.

The idea: a side file has the keys of `dataset.json` (docs/dataset.md) without `format`, plus `defaults`, a
table of trial keys that stand for every trial unless its own entry says otherwise, and `columns`, the
recording's names of the three force columns (or of thrust and torque). So one parser, with one set of
messages, serves all importers.

The assumption that breaks it: SI units in the side file; the name rule alone takes workshop units (rpm,
mm/min, mm).
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjx_cutting.trials.keys import Keys, shown
from mjx_cutting.trials.manifest import FORMAT, Manifest, parse_manifest

SIDE_FILES = ("conditions.toml", "conditions.json")
_NAME = re.compile(
    r"n(?P<rpm>\d+(?:\.\d+)?)f(?P<feed>\d+(?:\.\d+)?)ap(?P<ap>\d+(?:\.\d+)?)ae(?P<ae>\d+(?:\.\d+)?)", re.I
)


@dataclass(frozen=True)
class Plan:
    """What to import: the recordings, the manifest that says under which conditions, and the names of the
    columns.
    """

    files: tuple[Path, ...]
    manifest: Manifest
    columns: tuple[str, ...] | None


def conditions_from_name(name: str) -> dict[str, float]:
    """Trial keys in SI from a name such as "6-n6000f300ap3ae25.csv": n rpm, f mm/min, ap and ae mm; empty
    where it does not fit.
    """
    found = _NAME.search(name)
    if found is None:
        return {}
    return {
        "spindle_speed_rev_s": float(found["rpm"]) / 60,
        "feed_speed_m_s": float(found["feed"]) / 60_000,
        "axial_width_m": float(found["ap"]) / 1000,
        "radial_depth_m": float(found["ae"]) / 1000,
    }


def read_side_file(path: Path) -> dict[str, Any]:
    """The table in a TOML or JSON side file; raises ValueError where it cannot be read."""
    try:
        text = path.read_text(encoding="utf-8-sig")
        table = json.loads(text) if path.suffix.lower() == ".json" else tomllib.loads(text)
    except OSError as error:
        raise ValueError(
            f"{path}: got a side file that cannot be read ({error}), expected TOML or JSON; check the path."
        ) from None
    except ValueError as error:
        raise ValueError(
            f"{path}: got text that cannot be parsed ({error}), expected TOML or JSON; mend it."
        ) from None
    if not isinstance(table, dict):
        raise ValueError(f"{path}: got {shown(table)}, expected a table of keys; see docs/dataset.md.")
    return table


def merge_options(
    table: Mapping[str, Any],
    *,
    tool: Mapping[str, Any],
    trial: Mapping[str, Any],
    sensor: Mapping[str, Any],
    axes: Sequence[str] | None = None,
) -> dict[str, Any]:
    """A side file's table with options laid over it: tool, trial (as defaults) and sensor keys, and axes.

    A key whose value is None is not given.
    """
    merged = dict(table)
    for key, given in (("tool", tool), ("defaults", trial), ("sensor", sensor)):
        known = {name: value for name, value in given.items() if value is not None}
        if known:
            merged[key] = {**(merged.get(key) or {}), **known}
    if axes is not None:
        merged["axes"] = list(axes)
    return merged


def find_side_file(path: Path) -> Path | None:
    """The side file beside a recording or in a folder of recordings, or None."""
    folder = path if path.is_dir() else path.parent
    return next((folder / name for name in SIDE_FILES if (folder / name).is_file()), None)


def plan_import(
    path: Path,
    *,
    patterns: Sequence[str],
    conditions: Path | Mapping[str, Any] | None,
    name: str | None,
    sample_rate_hz: float | None,
) -> Plan:
    """Finds the recordings and their conditions.

    Arguments: path, a recording or a folder of them; patterns, what recordings are called in a folder;
    conditions, the side file, its content, or None for conditions.toml or conditions.json beside the
    recordings; name and sample_rate_hz, where the side file has none.

    Raises ValueError where no recording is found or the conditions are missing or broken; a fault in one
    trial's conditions leaves that one out.
    """
    table, where = _table(path, conditions)
    keys = Keys(table, "")
    defaults = {} if keys.absent("defaults") else keys.section("defaults").table
    columns = None if keys.absent("columns") else _columns(keys)
    entries = [] if keys.absent("trials") else table["trials"]
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise ValueError(
            f"{where}: trials: got {shown(entries)}, expected a list of tables; see docs/dataset.md."
        )
    files = _recordings(path, patterns, entries)
    own = {entry.get("file"): entry for entry in entries}
    trials = [
        {
            "kind": "cut",
            **conditions_from_name(file.name),
            **defaults,
            **own.get(file.name, {}),
            "file": file.name,
        }
        for file in files
    ]
    sensor = dict(table.get("sensor") or {})
    if sample_rate_hz is not None:
        sensor.setdefault("sample_rate_hz", sample_rate_hz)
    document = {key: value for key, value in table.items() if key not in ("defaults", "columns", "trials")}
    document |= {"format": FORMAT, "sensor": sensor, "trials": trials}
    try:
        manifest = parse_manifest(document, name=name or path.resolve().stem)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
    return Plan(tuple(files), manifest, columns)


def _table(path: Path, conditions: Path | Mapping[str, Any] | None) -> tuple[Mapping[str, Any], str]:
    if isinstance(conditions, Mapping):
        return conditions, "conditions"
    if conditions is not None:
        return read_side_file(conditions), str(conditions)
    found = find_side_file(path)
    if found is not None:
        return read_side_file(found), str(found)
    raise ValueError(
        f"{path}: got no conditions, expected {' or '.join(SIDE_FILES)} beside the recordings, or a side "
        "file given by name; "
        "write one with tool, sensor and trials (docs/dataset.md shows it)."
    )


def _columns(keys: Keys) -> tuple[str, ...]:
    columns = keys.table["columns"]
    if not isinstance(columns, list) or not all(isinstance(one, str) for one in columns):
        raise keys.fault(
            "columns", 'a list of column names such as ["Fx", "Fy", "Fz"]', "name the force columns"
        )
    return tuple(columns)


def _recordings(path: Path, patterns: Sequence[str], entries: Sequence[Mapping[str, Any]]) -> list[Path]:
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise ValueError(
            f"{path}: got no such file or folder, expected a recording or a folder of recordings; check the "
            "path."
        )
    if entries:
        names = [entry.get("file") for entry in entries]
        bad = [one for one in names if not isinstance(one, str)]
        if bad:
            raise ValueError(
                f'{path}: trials: got an entry without a file name, expected one in each; add file = "...".'
            )
        return [path / str(one) for one in names]
    files = sorted(
        {file for pattern in patterns for file in path.glob(pattern) if file.name not in SIDE_FILES}
    )
    if not files:
        raise ValueError(
            f"{path}: got no file like {', '.join(patterns)}, expected recordings; check the folder."
        )
    return files
