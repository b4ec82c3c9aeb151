"""A run folder is there before the work starts, and leaves no trace of work that came to nothing."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import pytest

from mjx_cutting.cli.folder import run_folder


@dataclass(frozen=True)
class Options:
    out: Path | None = None
    seed: int = 1


def test_folder_appears_whole_with_its_settings(tmp_path: Path) -> None:
    target = tmp_path / "a" / "run"
    with run_folder(target, "trace", Options(), 1) as (staged, folder):
        (staged / "verdict.json").write_text("{}")
        assert folder == target and not target.exists()
    assert sorted(path.name for path in target.iterdir()) == ["config.json", "verdict.json", "versions.json"]
    assert json.loads((target / "config.json").read_text())["verb"] == "trace"
    assert [path.name for path in target.parent.iterdir()] == ["run"]


@pytest.mark.parametrize("error", [ValueError, OSError, KeyboardInterrupt])
def test_failure_leaves_nothing(tmp_path: Path, error: type[BaseException]) -> None:
    with pytest.raises(error), run_folder(tmp_path / "run", "trace", Options(), 1) as (staged, _):
        (staged / "half.json").write_text("{")
        raise error
    assert list(tmp_path.iterdir()) == []


def test_default_is_under_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with run_folder(None, "fit-gp", Options(), None) as (_, folder):
        pass
    assert folder.parent == Path("runs") and folder.name.endswith("-fit-gp") and folder.is_dir()


def test_used_folder_is_refused_untouched(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("keep")
    with pytest.raises(ValueError, match="holds something already"):
        run_folder(tmp_path, "trace", Options(), 1).__enter__()
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
