"""DynoWare text exports (Kistler): header lines, a line of names beginning with Time, units, then numbers.

The idea: the export says when and what, not under which cutting conditions; those come from a side file, from
options, or from names such as "6-n6000f300ap3ae25.csv" (see `conditions`). Commas, semicolons and tabs,
decimal points and commas, N, kN and N m are understood.

The assumption that breaks it: one measuring cycle a file. Time is made to start at 0, because an export is a
window cut from a longer measurement whose own start means nothing.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mjx_cutting.trials.checks import Verdict, check_trial, finish
from mjx_cutting.trials.dataset import Array, Dataset, LeftOut, Trial
from mjx_cutting.trials.importers.conditions import Plan, plan_import
from mjx_cutting.trials.records import FORCES, TIME, TORQUE, records_of

PATTERNS = ("*.csv", "*.txt", "*.CSV", "*.TXT")
LONGEST_HEADER = 60
"""Lines searched for the line of names; exports have 15 to 20."""

_NAMES_LINE = re.compile(r"time[\t;,]", re.I)
_FACTORS = {
    "s": 1.0,
    "ms": 1e-3,
    "n": 1.0,
    "kn": 1e3,
    "nm": 1.0,
    "n m": 1.0,
    "n.m": 1.0,
    "ncm": 1e-2,
    "knm": 1e3,
}


@dataclass(frozen=True)
class DynoWareRecord:
    """One export: its header, its time from 0 [T] and its columns in SI units [T each]."""

    header: dict[str, str]
    time_s: Array
    columns: dict[str, Array]

    @property
    def sample_rate_hz(self) -> float:
        """The header's sampling rate, else the one of the time column [Hz]."""
        for key, value in self.header.items():
            if key.lower().startswith("sampling rate"):
                try:
                    return float(value.replace(",", "."))
                except ValueError:
                    break
        return (len(self.time_s) - 1) / float(self.time_s[-1])


def read_dynoware(path: str | os.PathLike[str]) -> DynoWareRecord:
    """One DynoWare text export. Raises ValueError where it is none, or is broken."""
    place = Path(path)
    try:
        with place.open(encoding="utf-8-sig", errors="replace", newline=None) as file:
            lines = [line.rstrip("\n") for _, line in zip(range(LONGEST_HEADER + 3), file, strict=False)]
    except OSError as error:
        raise ValueError(
            f"got a file that cannot be read ({error}), expected a DynoWare text export; check it."
        ) from None
    found = [row for row, line in enumerate(lines[:LONGEST_HEADER]) if _NAMES_LINE.match(line)]
    if not found:
        raise ValueError(
            f"got no line of names beginning with Time in the first {LONGEST_HEADER} lines, expected a "
            "DynoWare text export; "
            "export with time and units."
        )
    row = found[0]
    line, mark = lines[row], lines[row][len("Time")]
    if len(lines) < row + 3:
        raise ValueError("got a header without samples, expected lines of numbers; export the data again.")
    names = [name.strip() for name in line.split(mark)]
    units = [unit.strip().strip("[]") for unit in lines[row + 1].split(mark)]
    header = _header(lines[:row], mark)
    table = _numbers(
        place, names, mark, skip=row + 2, decimal="," if mark != "," and "," in lines[row + 2] else "."
    )
    if not len(table[0]):
        raise ValueError("got a header without samples, expected lines of numbers; export the data again.")
    scaled = []
    for name, unit, values in zip(names, [*units, *[""] * len(names)], table, strict=False):
        factor = _FACTORS.get(unit.lower().replace("·", " ").replace("-", ""))
        if factor is None:
            raise ValueError(
                f"got column {name} in {unit!r}, expected s, ms, N, kN or N m; export it in newtons."
            )
        scaled.append(values * factor)
    time_s = np.round(scaled[0] - scaled[0][0], 9)
    return DynoWareRecord(header, time_s, dict(zip(names[1:], scaled[1:], strict=True)))


def import_dynoware(
    path: str | os.PathLike[str],
    *,
    conditions: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    name: str | None = None,
) -> Dataset:
    """A checked dataset from a DynoWare text export or a folder of them.

    Arguments: path; conditions, the side file, its content as a mapping, or None for conditions.toml beside
    the recordings (see docs/dataset.md); name of the dataset, default the side file's or the path's.

    Raises ValueError where nothing can be imported; a bad recording is named in left_out with its reason.
    """
    place = Path(path)
    given = conditions if conditions is None or isinstance(conditions, Mapping) else Path(conditions)
    plan = plan_import(
        place, patterns=PATTERNS, conditions=given, name=name, sample_rate_hz=_first_rate(place)
    )
    outcomes = _outcomes(plan)
    manifest = plan.manifest
    return finish(manifest.without_trials(), outcomes, where=str(place))


def _outcomes(plan: Plan) -> list[tuple[Trial | LeftOut, Verdict]]:
    manifest = plan.manifest
    names = plan.columns or (("Fz", "Mz") if manifest.tool.measures_torque else ("Fx", "Fy", "Fz"))
    targets = (FORCES[2], TORQUE) if manifest.tool.measures_torque else FORCES
    if len(names) != len(targets):
        raise ValueError(
            f"columns: got {list(names)!r}, expected {len(targets)} names, for {', '.join(targets)}; name "
            "one column for each."
        )
    places = {file.name: file for file in plan.files}
    outcomes: list[tuple[Trial | LeftOut, Verdict]] = []
    for entry in manifest.entries:
        try:
            record = read_dynoware(places[entry.file])
            missing = [one for one in names if one not in record.columns]
            if missing:
                raise ValueError(
                    f"got columns {', '.join(record.columns)}, expected also {', '.join(missing)}; name the "
                    "columns in the side file."
                )
            columns = {TIME: record.time_s} | {
                t: record.columns[one] for t, one in zip(targets, names, strict=True)
            }
            records, warnings = records_of(columns, manifest.tool, manifest.axes)
            trial = Trial(file=f"{Path(entry.file).stem}.csv", **entry.conditions, **records)
        except ValueError as error:
            outcomes.append((LeftOut(entry.file, str(error)), Verdict()))
            continue
        verdict = check_trial(trial, manifest.tool, manifest.sensor, manifest.axes)
        outcomes.append((trial, Verdict(verdict.reasons, (*warnings, *verdict.warnings))))
    return outcomes


def _first_rate(path: Path) -> float | None:
    files = [path] if path.is_file() else sorted(file for pattern in PATTERNS for file in path.glob(pattern))
    for file in files:
        try:
            return read_dynoware(file).sample_rate_hz
        except ValueError:
            continue
    return None


def _header(lines: list[str], mark: str) -> dict[str, str]:
    pairs = (line.split(mark, 1) for line in lines)
    return {pair[0].strip().rstrip(":"): pair[1].strip() for pair in pairs if len(pair) == 2}


def _numbers(path: Path, names: list[str], mark: str, *, skip: int, decimal: str) -> list[Array]:
    import pyarrow as pa
    import pyarrow.csv as pc

    labels = [str(index) for index in range(len(names))]
    try:
        table = pc.read_csv(
            path,
            read_options=pc.ReadOptions(column_names=labels, skip_rows=skip),
            parse_options=pc.ParseOptions(delimiter=mark),
            convert_options=pc.ConvertOptions(
                column_types=dict.fromkeys(labels, pa.float64()), decimal_point=decimal
            ),
        )
    except pa.ArrowInvalid as error:
        raise ValueError(
            f"got lines that are not {len(names)} numbers each ({error}); export the data again."
        ) from None
    return [
        np.asarray(table[label].combine_chunks().to_numpy(zero_copy_only=False), dtype=np.float64)
        for label in labels
    ]
