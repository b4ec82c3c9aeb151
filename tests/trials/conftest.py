"""A small sound dataset folder, written without the package's own writer, for tests to spoil."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

Columns = dict[str, np.ndarray]

DOCUMENT: dict[str, Any] = {
    "format": "mjx-cutting-trials/1",
    "name": "sound",
    "source": "made by a test",
    "licence": "CC0-1.0",
    "tool": {"kind": "end_mill", "teeth": 2, "diameter_m": 0.025, "helix_rad": 0.5},
    "sensor": {
        "sample_rate_hz": 1000.0,
        "noise_std_n": [0.1, 0.2, 0.3],
        "zeroed": "session",
        "units": "SI",
        "anti_alias": {"kind": "butterworth", "order": 4, "hz": 200.0, "zero_phase": False},
    },
    "axes": None,
    "trials": [],
}

ENTRY: dict[str, Any] = {
    "kind": "cut",
    "milling": "conventional",
    "spindle_speed_rev_s": 21.0,
    "feed_speed_m_s": 0.0021,
    "radial_depth_m": 0.001,
    "axial_width_m": 0.003,
    "material": "aluminium",
    "tool_id": "a",
    "cut_length_before_m": 0.25,
    "clock_start_s": 60.0,
}


def mill_columns(seed: int = 0, samples: int = 1000) -> Columns:
    """A noisy two-tooth-like record at 1 kHz."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(samples) / 1000.0
    wave = 50 * np.sin(2 * np.pi * 42.0 * time_s)
    force = wave[:, None] * [1.0, 2.0, 0.3] + rng.normal(size=(samples, 3))
    return {"time_s": time_s, "force_x_n": force[:, 0], "force_y_n": force[:, 1], "force_z_n": force[:, 2]}


def drill_columns(seed: int = 0, samples: int = 1000) -> Columns:
    """A noisy drill record at 1 kHz."""
    rng = np.random.default_rng(seed)
    return {
        "time_s": np.arange(samples) / 1000.0,
        "force_z_n": 300 + rng.normal(size=samples),
        "torque_z_nm": 2 + 0.1 * rng.normal(size=samples),
    }


class Folder:
    """A dataset folder under construction: change `document` and `records`, then `write`."""

    def __init__(self, path: Path, trials: int = 2) -> None:
        self.path = path
        self.document = copy.deepcopy(DOCUMENT)
        self.document["trials"] = [{"file": f"t{i}.csv", **ENTRY} for i in range(trials)]
        self.records: dict[str, Columns | str | None] = {f"t{i}.csv": mill_columns(i) for i in range(trials)}

    def entry(self, index: int = 1) -> dict[str, Any]:
        return self.document["trials"][index]

    def columns(self, file: str = "t1.csv") -> Columns:
        columns = self.records[file]
        assert isinstance(columns, dict)
        return columns

    def write(self) -> Path:
        self.path.mkdir(parents=True, exist_ok=True)
        (self.path / "dataset.json").write_text(json.dumps(self.document))
        for file, record in self.records.items():
            if isinstance(record, str):
                (self.path / file).write_text(record)
            elif record is not None:
                save_csv(self.path / file, record)
        return self.path


def save_csv(path: Path, columns: Columns) -> None:
    rows = [",".join(columns)] + [
        ",".join(repr(float(v)) for v in row) for row in zip(*columns.values(), strict=True)
    ]
    path.write_text("\n".join(rows) + "\n")


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    return Folder(tmp_path / "sound")


@pytest.fixture
def make_folder(tmp_path: Path) -> Callable[..., Folder]:
    return lambda name="sound", trials=2: Folder(tmp_path / name, trials)


@pytest.fixture
def mill_record() -> Callable[..., Columns]:
    return mill_columns


@pytest.fixture
def drill_record() -> Callable[..., Columns]:
    return drill_columns
