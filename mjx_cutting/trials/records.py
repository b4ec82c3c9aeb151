"""The columns of one trial's file, CSV or Parquet, as float64 arrays.

The idea: only the columns the format knows are parsed, by Arrow, so that a hundred trials of 50,000 samples
take seconds. What is missing, is not a number or cannot be read is a ValueError whose text can stand as the
reason for leaving the trial out.

The assumption that breaks it: one header line, comma-separated, decimal points. Anything else is told so.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mjx_cutting.trials.dataset import (
    Array,
    ToolInfo,
    columns_to_process,
    process_to_columns,
)

TIME = "time_s"
FORCES = ("force_x_n", "force_y_n", "force_z_n")
TORQUE = "torque_z_nm"
POSITIONS = ("position_x_m", "position_y_m", "position_z_m")
SINGLES = {
    "spindle_angle_rad": "spindle_angle_rad",
    "spindle_speed_rev_s": "spindle_speed_measured_rev_s",
    "feed_speed_m_s": "feed_speed_measured_m_s",
}
"""Optional columns and the `Trial` field each becomes."""

KNOWN = (TIME, *FORCES, TORQUE, *POSITIONS, *SINGLES)
SUFFIXES = (".csv", ".parquet")


def required_columns(tool: ToolInfo) -> tuple[str, ...]:
    """The columns a trial of this tool must have."""
    return (TIME, FORCES[2], TORQUE) if tool.measures_torque else (TIME, *FORCES)


def read_columns(path: Path, required: Sequence[str]) -> tuple[dict[str, Array], list[str]]:
    """The known columns of a trial's file [T each] and the names of its other columns.

    Raises ValueError where the file is missing, cannot be parsed or lacks a required column.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(
            f"got a file ending in {path.suffix!r}, expected .csv or .parquet; convert the file."
        )
    if not path.is_file():
        raise ValueError(
            "got no such file in the dataset folder, expected it beside dataset.json; add it or remove the "
            "entry."
        )
    parquet = path.suffix.lower() == ".parquet"
    try:
        header = _parquet_header(path) if parquet else _csv_header(path)
        missing = [name for name in required if name not in header]
        if missing:
            raise ValueError(_missing(missing, header))
        twice = sorted({name for name in header if name in KNOWN and header.count(name) > 1})
        if twice:
            raise ValueError(
                f"got column {', '.join(twice)} twice, expected each once; remove or rename one."
            )
        columns = _parquet_columns(path, header) if parquet else _csv_columns(path, header)
    except OSError as error:
        raise ValueError(
            f"got a file that cannot be read ({error}), expected a whole CSV or Parquet file; record it "
            "again."
        ) from None
    lengths = {name: len(values) for name, values in columns.items()}
    if not all(lengths.values()):
        raise ValueError("got a file without samples, expected at least two revolutions; record it again.")
    return columns, [name for name in header if name not in KNOWN]


def records_of(
    columns: Mapping[str, Array], tool: ToolInfo, axes: Sequence[str] | None
) -> tuple[dict[str, Any], list[str]]:
    """The record arguments of `Trial`, forces in process axes, from a file's columns; and warnings on
    optional columns not used.
    """
    time_s = columns[TIME]
    warnings = []
    records: dict[str, Any] = {"time_s": time_s}
    if tool.measures_torque:
        sign = -1.0 if axes is not None and axes[2] == "-z" else 1.0
        unmeasured = np.full_like(time_s, np.nan)
        records["force_n"] = np.stack([unmeasured, unmeasured, sign * columns[FORCES[2]]], axis=-1)
        records["torque_nm"] = columns[TORQUE]
    else:
        records["force_n"] = columns_to_process(np.stack([columns[name] for name in FORCES], axis=-1), axes)
    positions = [name for name in POSITIONS if name in columns]
    usable = {name for name in (*POSITIONS, *SINGLES) if name in columns and np.isfinite(columns[name]).all()}
    for name in (*positions, *(one for one in SINGLES if one in columns)):
        if name not in usable:
            warnings.append(
                f"column {name}: got values that are not finite, expected numbers; the column is not used."
            )
    if positions and usable.issuperset(positions):
        lacking = [name for name in POSITIONS if name not in positions]
        if POSITIONS[0] in lacking:  # the feed's own; that y and z stand still is usual
            warnings.append(
                f"columns {', '.join(positions)}: {', '.join(lacking)} missing; taken as not moving, zero."
            )
        still = np.zeros_like(time_s)
        records["position_m"] = np.stack([columns.get(name, still) for name in POSITIONS], axis=-1)
    for name, field in SINGLES.items():
        if name in usable:
            records[field] = columns[name]
    return records, warnings


def columns_of(trial: Any, tool: ToolInfo, axes: Sequence[str] | None) -> dict[str, Array]:
    """The columns of a `Trial`, in the file's axes and order: undoes `records_of`."""
    columns = {TIME: trial.time_s}
    if tool.measures_torque:
        columns[FORCES[2]] = (
            -trial.force_n[:, 2] if axes is not None and axes[2] == "-z" else trial.force_n[:, 2]
        )
        columns[TORQUE] = trial.torque_nm
    else:
        force = process_to_columns(trial.force_n, axes)
        columns |= {name: force[:, index] for index, name in enumerate(FORCES)}
    if trial.position_m is not None:
        columns |= {name: trial.position_m[:, index] for index, name in enumerate(POSITIONS)}
    for name, field in SINGLES.items():
        if getattr(trial, field) is not None:
            columns[name] = getattr(trial, field)
    return columns


def write_columns(path: Path, columns: Mapping[str, Array]) -> None:
    """Writes columns as CSV (shortest text that gives the same float64 back) or Parquet, by the file's
    suffix.
    """
    import pyarrow as pa

    table = pa.table({name: np.ascontiguousarray(values) for name, values in columns.items()})
    if path.suffix.lower() == ".parquet":
        import pyarrow.parquet as pq

        pq.write_table(table, path)
        return
    import pyarrow.csv as pc

    with path.open("wb") as file:
        file.write((",".join(columns) + "\n").encode())
        pc.write_csv(table, file, pc.WriteOptions(include_header=False))


def _missing(missing: Sequence[str], header: Sequence[str]) -> str:
    found = ", ".join(header[:12]) if header else "no header line"
    hint = "rename the columns or record them"
    if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
        hint = "separate the columns by commas, with decimal points"
    return f"got columns {found}, expected also {', '.join(missing)}; {hint}."


def _csv_header(path: Path) -> list[str]:
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        line = file.readline()
    return [name.strip() for name in next(csv.reader([line]), [])]


def _csv_columns(path: Path, header: list[str]) -> dict[str, Array]:
    import pyarrow as pa
    import pyarrow.csv as pc

    wanted = [name for name in dict.fromkeys(header) if name in KNOWN]
    names = [name if name in KNOWN else f"{index}:{name}" for index, name in enumerate(header)]
    read = pc.ReadOptions(column_names=names, skip_rows=1)
    convert = pc.ConvertOptions(
        column_types=dict.fromkeys(wanted, pa.float64()), include_columns=wanted, strings_can_be_null=True
    )
    try:
        table = pc.read_csv(path, read_options=read, convert_options=convert)
    except pa.ArrowInvalid as error:
        if "Empty CSV" in str(error):
            return {name: np.empty(0) for name in wanted}
        raise ValueError(
            f"got text that is not a table of numbers ({error}), expected comma-separated numbers; mend it."
        ) from None
    return {name: _floats(table[name]) for name in wanted}


def _parquet_header(path: Path) -> list[str]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        return list(pq.read_schema(path).names)
    except pa.ArrowInvalid as error:
        raise ValueError(
            f"got a file that is not whole Parquet ({error}), expected one with its footer; record it again."
        ) from None


def _parquet_columns(path: Path, header: list[str]) -> dict[str, Array]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    wanted = [name for name in header if name in KNOWN]
    try:
        table = pq.read_table(path, columns=wanted)
    except pa.ArrowInvalid as error:
        raise ValueError(
            f"got a Parquet file that cannot be read ({error}), expected a whole file; record it again."
        ) from None
    for name in wanted:
        if not (
            pa.types.is_floating(table.schema.field(name).type)
            or pa.types.is_integer(table.schema.field(name).type)
        ):
            raise ValueError(
                f"got column {name} of type {table.schema.field(name).type}, expected numbers; convert it "
                "to double."
            )
    return {name: _floats(table[name]) for name in wanted}


def _floats(column: Any) -> Array:
    """A float64 array of an Arrow column; a null becomes NaN."""
    values = column.combine_chunks().to_numpy(zero_copy_only=False)
    return np.asarray(values, dtype=np.float64)
