"""Trials being recorded: one-second parts that survive being killed, and what merges them into a dataset.

A Parquet file has its index at its end, so one that is cut off is lost. A recording therefore lies, second by
second, in small whole files:

    FOLDER/dataset.json                      the trials finished so far
    FOLDER/0001-02-cut.parquet               one of them
    FOLDER/.recording/session.json           tool, sensor and conditions, as in dataset.json
    FOLDER/.recording/0002/000017.parquet    the 18th second of the trial being recorded
    FOLDER/.recording/lock                   held by the process that records

`merge` makes trials of parts: samples are put on an even grid (a gap of a few lost samples is bridged by
linear interpolation, a longer one ends the trial), and what lies before the tool touches the sheet becomes
an "air" trial apart from the "cut". `recover` merges whatever a killed recorder left; the reader calls it.

The assumption that breaks it: the controller's clock marks the samples, and one session is one folder's.
"""

from __future__ import annotations

import fcntl
import json
import math
import os
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mjx_cutting._files import write_atomic
from mjx_cutting.trials.dataset import Array
from mjx_cutting.trials.manifest import FORMAT, parse_manifest
from mjx_cutting.trials.records import FORCES, POSITIONS, TIME, write_columns

RECORDING = ".recording"
SESSION = "session.json"
BASE_AXES = ("+z", "-x", "-y")
"""Process axes that the robot's base axes x, y, z measure."""

ANGLE, SPEED, FEED = "spindle_angle_rad", "spindle_speed_rev_s", "feed_speed_m_s"
SAMPLE = np.dtype(
    [("time_ns", "<i8"), ("flags", "<i8")]
    + [(name, "<f8") for name in (*FORCES, *POSITIONS, ANGLE, SPEED, FEED, "path_m", "cut_length_m")]
    + [(name, "<f8") for name in ("stiffness_x", "stiffness_y", "stiffness_z", "feed_adjustment", "depth_m")]
)
"""One sample as recorded: the controller's clock, flags, base axes, and the set-points in force."""

HAS_ANGLE, HAS_SPEED = 8, 16
"""Bits of `flags`: the spindle's angle, its speed, was measured."""

BRIDGED_SAMPLES = 5
"""Longest gap, in sampling intervals, that is interpolated."""

TOUCH_M = 1e-6
"""Growth of the cut length that counts as cutting."""

_TRIAL_KEYS = ("milling", "material", "axial_width_m", "tool_id", SPEED)


def check_session(session: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the description of a session, checked and completed.

    Arguments: session, with name, source, licence, tool, sensor and axes as in dataset.json (axes default to
    the robot's base); trial, which has milling, material, axial_width_m, tool_id and spindle_speed_rev_s;
    margin_s, default 0.5, which is left out at both ends of a cut.

    Raises:
        ValueError: something is missing or wrong, with its key path.
    """
    unknown = set(session) - {"name", "source", "licence", "tool", "sensor", "axes", "trial", "margin_s"}
    if unknown:
        raise ValueError(f"session: got the keys {', '.join(sorted(unknown))}; expected none of them")
    trial = session.get("trial")
    if not isinstance(trial, Mapping) or set(trial) - set(_TRIAL_KEYS):
        raise ValueError(f"session.trial: got {trial!r}; expected an object with {', '.join(_TRIAL_KEYS)}")
    margin = session.get("margin_s", 0.5)
    if isinstance(margin, bool) or not isinstance(margin, int | float) or not 0 <= margin < 60:
        raise ValueError(f"session.margin_s: got {margin!r}; expected seconds, 0 to 60")
    checked = {"name": None, "source": None, "licence": None, **session, "margin_s": float(margin)}
    checked["axes"] = list(session.get("axes") or BASE_AXES)
    probe = {"file": "x.parquet", "kind": "cut", FEED: 0.01, "radial_depth_m": 0.001, **trial}
    manifest = parse_manifest(_document(checked, [probe]), name="session")
    if manifest.left_out:
        raise ValueError(f"session.trial: {manifest.left_out[0].reason}")
    return checked


class Parts:
    """Writes the parts of one session; the folder is locked against a second recorder and the reader.

    Arguments:
        folder: the dataset's; made where missing. What an earlier session left unmerged there is merged.
        session: see `check_session`; it must be that of the dataset where one is there.

    Raises:
        ValueError: the folder is being recorded to, or holds a dataset of another tool or sensor.
        OSError: it cannot be written.
    """

    def __init__(self, folder: Path, session: Mapping[str, Any]):
        self.folder, self.session = folder, check_session(session)
        recover(folder)
        (folder / RECORDING).mkdir(parents=True, exist_ok=True)
        self._lock = _lock(folder)
        if self._lock is None:
            raise ValueError(f"{folder}: got a folder that is being recorded to; choose another")
        if (folder / "dataset.json").exists():
            _check_same(folder, self.session)
        write_atomic(folder / RECORDING / SESSION, json.dumps(self.session, indent=1, allow_nan=False))
        self._place: Path | None = None
        self._part = 0

    def begin(self) -> None:
        """Starts a trial."""
        self._place = self.folder / RECORDING / f"{_next_number(self.folder):04d}"
        self._place.mkdir()
        self._part = 0

    def add(self, samples: np.ndarray) -> None:
        """Writes one part, [n] of `SAMPLE`, whole or not at all."""
        assert self._place is not None
        target = self._place / f"{self._part:06d}.parquet"
        staged = target.with_name(f".{target.name}")
        write_columns(staged, {name: samples[name] for name in SAMPLE.names or ()})
        with staged.open("rb") as file:
            os.fsync(file.fileno())
        staged.replace(target)
        self._part += 1

    def end(self) -> list[str]:
        """Merges the trial's parts; returns what there is to say about it."""
        place, self._place = self._place, None
        return merge(self.folder, place, self.session) if place is not None else []

    def close(self) -> list[str]:
        """Ends the session: merges what is left and lets go of the folder."""
        told = self.end()
        shutil.rmtree(self.folder / RECORDING)
        if self._lock is not None:
            os.close(self._lock)
        return told


def recover(folder: Path) -> list[str]:
    """Merges what a recorder that was killed left in a dataset folder; returns what there is to say.

    Nothing happens where no parts are left or a living recorder holds them. Killed itself, it is simply run
    again.

    Raises:
        OSError: the folder cannot be written.
    """
    place = folder / RECORDING
    if not place.is_dir():
        return []
    lock = _lock(folder)
    if lock is None:
        return []
    told = []
    try:
        try:
            session = json.loads((place / SESSION).read_text())
        except (OSError, ValueError):
            session = None  # killed before the first sample
        if session is not None:
            for trial in sorted(p for p in place.iterdir() if p.is_dir()):
                told += merge(folder, trial, session)
        shutil.rmtree(place)
    finally:
        os.close(lock)
    return told


def merge(folder: Path, place: Path, session: Mapping[str, Any]) -> list[str]:
    """Makes trials of one folder of parts, lists them in dataset.json, and removes the parts.

    Returns what there is to say: samples bridged, gaps, pieces too short.
    """
    samples, told = _read(place)
    rate_hz = float(session["sensor"]["sample_rate_hz"])
    entries: list[dict[str, Any]] = []
    for kind, piece in _pieces(samples, rate_hz, float(session["margin_s"])):
        if len(piece) < max(8, 2.0 * rate_hz / session["trial"][SPEED] + 1):
            if len(piece):
                told.append(f"trial {place.name}: {len(piece)} samples of {kind} are under 2 turns, left out")
            continue
        file = f"{place.name}-{len(entries) + 1:02d}-{kind}.parquet"
        grid, bridged = _even(piece, rate_hz)
        staged = folder / f".{file}"
        write_columns(staged, _columns(grid, rate_hz))
        staged.replace(folder / file)
        entries.append(_entry(file, kind, grid, session))
        told.append(f"{file}: {len(grid['time_ns'])} samples, {bridged} of them interpolated")
    _list(folder, session, place.name, entries)
    shutil.rmtree(place)
    return told


# -- pieces


def _read(place: Path) -> tuple[np.ndarray, list[str]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    read, told = [], []
    for part in sorted(place.glob("[0-9]*.parquet")):
        try:
            table = pq.read_table(part)
            samples = np.empty(table.num_rows, SAMPLE)
            for name in SAMPLE.names or ():
                samples[name] = table[name].to_numpy()
        except (pa.ArrowException, OSError, KeyError) as error:
            told.append(f"part {part.name} of trial {place.name} cannot be read ({error}), left out")
            continue
        read.append(samples)
    samples = np.concatenate(read) if read else np.empty(0, SAMPLE)
    return samples[np.argsort(samples["time_ns"], kind="stable")], told


def _pieces(samples: np.ndarray, rate_hz: float, margin_s: float) -> Iterator[tuple[str, np.ndarray]]:
    """Runs without a long gap, parted into air before the first touch, and the cut without its margins."""
    if not len(samples):
        return
    gaps = np.flatnonzero(np.diff(samples["time_ns"]) > BRIDGED_SAMPLES * 1e9 / rate_hz * 1.01)
    length = samples["cut_length_m"]
    grows = np.diff(length) > 0
    first, last = (np.flatnonzero(grows)[[0, -1]]) if length[-1] - length[0] > TOUCH_M else (len(length), -1)
    margin = round(margin_s * rate_hz)
    where = np.arange(len(samples))
    for run in np.split(where, gaps + 1):
        yield "air", samples[run[run <= first]]
        if last >= 0:
            yield "cut", samples[run[(run > first + margin) & (run <= last - margin)]]


def _even(piece: np.ndarray, rate_hz: float) -> tuple[dict[str, Any], int]:
    time_s = (piece["time_ns"] - piece["time_ns"][0]) * 1e-9
    count = math.floor(time_s[-1] * rate_hz + 0.5) + 1
    grid_s = np.arange(count) / rate_hz
    columns: dict[str, Any] = {"time_ns": piece["time_ns"][0] + np.round(grid_s * 1e9).astype(np.int64)}
    for name in SAMPLE.names or ():
        if name == ANGLE:
            columns[name] = np.interp(grid_s, time_s, np.unwrap(piece[name]))
        elif name not in ("time_ns", "flags"):
            columns[name] = np.interp(grid_s, time_s, piece[name])
    columns["flags"] = np.bitwise_and.reduce(piece["flags"])
    return columns, max(0, count - len(piece))


def _columns(grid: Mapping[str, Any], rate_hz: float) -> dict[str, Array]:
    columns = {TIME: np.arange(len(grid["time_ns"])) / rate_hz}
    columns |= {name: grid[name] for name in (*FORCES, *POSITIONS)}
    if grid["flags"] & HAS_ANGLE:
        columns[ANGLE] = grid[ANGLE]
    if grid["flags"] & HAS_SPEED:
        columns[SPEED] = grid[SPEED]
    columns[FEED] = grid[FEED]
    return columns


# -- dataset.json


def _entry(file: str, kind: str, grid: Mapping[str, Any], session: Mapping[str, Any]) -> dict[str, Any]:
    trial = session["trial"]
    return {
        "file": file,
        "kind": kind,
        **{key: trial.get(key) for key in _TRIAL_KEYS},
        FEED: max(0.0, float(np.mean(grid[FEED]))),
        "radial_depth_m": max(0.0, float(np.mean(grid["depth_m"]))),
        "cut_length_before_m": max(0.0, float(grid["cut_length_m"][0])),
        "clock_start_s": float(grid["time_ns"][0]) * 1e-9,
    }


def _document(session: Mapping[str, Any], entries: list[dict[str, Any]]) -> dict[str, Any]:
    head = {key: session[key] for key in ("name", "source", "licence", "tool", "sensor", "axes")}
    return {"format": FORMAT, **head, "trials": entries}


def _list(folder: Path, session: Mapping[str, Any], number: str, entries: list[dict[str, Any]]) -> None:
    path = folder / "dataset.json"
    document = json.loads(path.read_text()) if path.exists() else _document(session, [])
    others = [entry for entry in document["trials"] if not entry["file"].startswith(f"{number}-")]
    document["trials"] = sorted([*others, *entries], key=lambda entry: entry["file"])
    if document["trials"]:
        write_atomic(path, json.dumps(document, indent=2, allow_nan=False) + "\n")


def _check_same(folder: Path, session: Mapping[str, Any]) -> None:
    there = json.loads((folder / "dataset.json").read_text())
    for key in ("tool", "sensor", "axes"):
        if there.get(key) != session[key]:
            raise ValueError(
                f"{folder}: got a dataset with {key} {there.get(key)}; expected {session[key]}, that of this "
                "session; record to another folder"
            )


def _next_number(folder: Path) -> int:
    names = [path.name for path in (*folder.glob("[0-9]*"), *(folder / RECORDING).glob("[0-9]*"))]
    return 1 + max((int(name[:4]) for name in names if name[:4].isdigit()), default=0)


def _lock(folder: Path) -> int | None:
    descriptor = os.open(folder / RECORDING / "lock", os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o666)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        return None
    return descriptor
