"""`mjx-cutting data`: lists, checks and imports, and says what is wrong with what it is given."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mjx_cutting.cli import main


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A dataset of three trials, one of which has a value missing."""
    place = tmp_path / "mine"
    place.mkdir()
    time_s = np.arange(0, 1, 0.001)
    trial = {"kind": "cut", "milling": "slot", "spindle_speed_rev_s": 25.0, "radial_depth_m": 0.025}
    trials = []
    for number in range(3):
        force_n = 10 * np.sin(2 * np.pi * 50 * time_s + number)
        force_n[500] = np.nan if number == 2 else force_n[500]
        columns = np.column_stack([time_s, force_n, 2 * force_n + 1, -force_n])
        header = "time_s,force_x_n,force_y_n,force_z_n"
        np.savetxt(place / f"t{number}.csv", columns, delimiter=",", header=header, comments="", fmt="%.6f")
        trials.append({**trial, "file": f"t{number}.csv", "feed_speed_m_s": 0.005, "axial_width_m": 0.001})
    document = {
        "format": "mjx-cutting-trials/1",
        "tool": {"kind": "end_mill", "teeth": 2, "diameter_m": 0.025},
        "sensor": {"sample_rate_hz": 1000.0},
        "trials": trials,
    }
    (place / "dataset.json").write_text(json.dumps(document))
    return place


def test_list_names_source_and_licence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["data", "list"]) == 0
    shown = capsys.readouterr().out
    for name in ("slotting", "drilling"):
        assert f"{name}\n" in shown
    assert "licence" in shown and "github.com" in shown


def test_check_names_the_bad_trial(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["data", "check", str(folder)]) == 1
    shown = capsys.readouterr().out
    assert "2 good, 1 left out" in shown
    assert "left out t2.csv:" in shown


def test_check_of_good_trials_passes(folder: Path) -> None:
    document = json.loads((folder / "dataset.json").read_text())
    document["trials"].pop()
    (folder / "dataset.json").write_text(json.dumps(document))
    assert main(["data", "check", str(folder)]) == 0


@pytest.mark.parametrize("verb", ["get", "check"])
def test_unknown_name(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["data", verb, "milling-of-mars"]) == 2
    assert "expected slotting" in capsys.readouterr().err


def test_import_of_nothing_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["data", "import", "dynoware", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.startswith("error: ")
    assert not (tmp_path / "out").exists()


@pytest.mark.measured
@pytest.mark.parametrize(("name", "trials"), [("slotting", 5), ("drilling", 333)])
def test_import_check_and_refusal_to_overwrite(
    name: str, trials: int, measured_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["data", "import", name, str(measured_data / name), "--out", str(tmp_path / "out")]
    assert main(words) == 0
    assert main(["data", "check", str(tmp_path / "out")]) == 0
    assert f"{trials} good, " in capsys.readouterr().out
    assert main(words) == 2
    assert "is there already" in capsys.readouterr().err


@pytest.mark.measured
def test_get_finds_the_local_copy(
    measured_data: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("MJX_CUTTING_DATA", str(measured_data))
    assert main(["data", "get", "slotting", "--out", str(tmp_path / "out")]) == 0
    assert str(measured_data / "slotting") in capsys.readouterr().out
    assert (tmp_path / "out" / "dataset.json").is_file()
