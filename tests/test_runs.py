"""A run folder names the command, settings and versions behind a figure."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from mjx_cutting import runs


@dataclass(frozen=True)
class Config:
    depth_m: float = 0.001
    out: Path = Path("x")
    gains: tuple[float, ...] = (1.0, 2.0)


def test_run_folder_holds_config_and_versions(tmp_path: Path) -> None:
    folder = runs.open_run(tmp_path / "run", "train", Config(), seed=3)
    assert json.loads((folder / "config.json").read_text()) == {
        "verb": "train",
        "seed": 3,
        "config": {"depth_m": 0.001, "out": "x", "gains": [1.0, 2.0]},
    }
    told = json.loads((folder / "versions.json").read_text())
    assert told["versions"]["mujoco"] == "3.17.0"
    assert told["machine"]["cpus"] >= 1
    assert told["command"]


def test_default_folders_differ(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    folders = {runs.open_run(None, "trace", {}, seed=None) for _ in range(3)}
    assert len(folders) == 3
    assert all(re.fullmatch(r"runs/\d{8}T\d{6}Z-trace(-\d)?", str(folder)) for folder in folders)


def test_metrics_are_one_json_object_a_line(tmp_path: Path) -> None:
    runs.append_metrics(tmp_path, {"step": np.int64(1), "reward": np.float32(0.5)})
    runs.append_metrics(tmp_path, {"step": 2, "reward": float("nan"), "forces": np.array([1.0, np.inf])})
    lines = [json.loads(line) for line in (tmp_path / "metrics.jsonl").read_text().splitlines()]
    assert lines == [{"step": 1, "reward": 0.5}, {"step": 2, "reward": None, "forces": [1.0, None]}]


def test_a_setting_that_json_cannot_hold_leaves_no_folder(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match=r"got a object .* expected numbers"):
        runs.open_run(tmp_path / "run", "train", {"x": object()}, seed=0)
    assert not (tmp_path / "run").exists()


def test_git_revision_of_this_checkout() -> None:
    revision = runs.git_revision()
    assert revision is None or re.fullmatch(r"[0-9a-f]{40}", revision["commit"])
