"""`mjx-cutting loop`: what it refuses before any work (tests/loop/test_rounds.py goes round)."""

from __future__ import annotations

from pathlib import Path

import pytest

from mjx_cutting.cli import main


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--material", "oak"), "expected one of foam, plastic"),
        (("--effects", "missing.toml"), "cannot be read as TOML"),
    ],
)
def test_bad_input(
    words: tuple[str, ...], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["loop", "--out", str(tmp_path / "out"), *words]) == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("words", [("--rounds", "0"), ("--trials", "50"), ("--preset", "huge")])
def test_option_out_of_range(words: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["loop", *words])
    assert ended.value.code == 2 and words[0].strip("-") in capsys.readouterr().err
