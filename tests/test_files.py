"""Files are whole or not there, whatever goes wrong in between."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

import pytest

from mjx_cutting._files import explain, staged_folder, write_atomic


def test_write_makes_the_folder_and_replaces(tmp_path: Path) -> None:
    path = write_atomic(tmp_path / "a" / "b.txt", "first\n")
    assert write_atomic(path, "zweite é\n").read_bytes() == "zweite é\n".encode()
    assert write_atomic(path, b"\x00\xff").read_bytes() == b"\x00\xff"
    assert [p.name for p in path.parent.iterdir()] == ["b.txt"]


def test_written_file_has_the_usual_mode(tmp_path: Path) -> None:
    old = os.umask(0o027)
    try:
        path = write_atomic(tmp_path / "a.txt", "x")
    finally:
        os.umask(old)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


def test_full_disk_leaves_the_old_file_and_no_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_atomic(tmp_path / "a.txt", "old")

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError) as caught:
        write_atomic(path, "new")
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert explain(caught.value) == (
        f"{path}: No space left on device (the disk is full; free some space or choose another --out)"
    )


def test_staged_folder_appears_whole(tmp_path: Path) -> None:
    target = tmp_path / "out" / "run"
    with staged_folder(target) as staged:
        (staged / "one.txt").write_text("1")
        assert not target.exists()
    assert (target / "one.txt").read_text() == "1"
    assert [p.name for p in target.parent.iterdir()] == ["run"]


def test_failed_staged_folder_vanishes(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), staged_folder(tmp_path / "run") as staged:
        (staged / "one.txt").write_text("1")
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_staged_folder_refuses_a_used_name(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "mine.txt").write_text("keep")
    with pytest.raises(FileExistsError, match="is there already"), staged_folder(tmp_path / "run"):
        pass
    assert (tmp_path / "run" / "mine.txt").read_text() == "keep"


def test_staged_folder_takes_an_empty_one(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    with staged_folder(tmp_path / "run") as staged:
        (staged / "a").write_text("1")
    assert (tmp_path / "run" / "a").exists()


@pytest.mark.parametrize(
    ("inside", "told"), [("a.txt", "in the way"), ("sub/a.txt", "part of the path is a file")]
)
def test_path_through_a_file_is_explained(tmp_path: Path, inside: str, told: str) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(OSError) as caught:
        write_atomic(tmp_path / "file" / inside, "x")
    assert told in explain(caught.value)
    assert str(tmp_path / "file" / inside) in explain(caught.value)
