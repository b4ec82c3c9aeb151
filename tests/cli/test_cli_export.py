"""`mjx-cutting export`: writes, verifies, and leaves nothing behind when it cannot."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mjx_cutting.cli import main
from mjx_cutting.deploy.artefact import Artefact

Command = Callable[..., "subprocess.CompletedProcess[str]"]


def test_exports_and_verifies(trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(trained), "--out", str(tmp_path / "p.npz")]) == 0
    shown = capsys.readouterr().out
    assert "golden pairs reproduced" in shown and str(tmp_path / "p.npz") in shown
    assert main(["export", str(tmp_path / "p.npz"), "--verify"]) == 0


def test_default_is_in_the_run_folder(trained: Path) -> None:
    assert main(["export", str(trained)]) == 0
    assert (trained / "policy-export.npz").is_file()
    assert main(["export", str(trained), "--verify"]) == 0


def test_says_what_the_observations_mean(trained: Path) -> None:
    main(["export", str(trained)])
    conventions = Artefact.load(trained / "policy-export.npz").conventions
    assert "mean of the last 10 samples of the sensor at 500 Hz" in conventions["force"]
    assert "base axes" in conventions["frames"] and "0.0125 m/s" in conventions["feed"]


def test_tampered_file_fails_verification(trained: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["export", str(trained)])
    path = trained / "policy-export.npz"
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    arrays["bias_0"] = arrays["bias_0"] + 1
    np.savez(path, **arrays)
    assert main(["export", str(path), "--verify"]) == 2
    assert "was changed or damaged" in capsys.readouterr().err


def test_folder_without_a_policy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(tmp_path)]) == 2
    assert "expected a policy.npz written by training" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("option", [("--pairs", "0"), ("--pairs", "-3")])
def test_option_out_of_range(
    trained: Path, option: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(trained), *option]) == 2
    assert "expected" in capsys.readouterr().err
    assert sorted(path.name for path in trained.iterdir()) == ["config.json", "policy.npz", "versions.json"]


def test_full_disk(trained: Path, full_disk: tuple[Path, str, str], command: Command) -> None:
    folder, first, told = full_disk
    done = command("export", trained, "--out", folder / "p.npz", "--pairs", 2000, first=first)
    assert done.returncode == 2, done.stderr
    assert told in done.stderr and str(folder / "p.npz") in done.stderr and "Traceback" not in done.stderr
    assert list(folder.iterdir()) == []


def test_unwritable_folder(trained: Path, unwritable: tuple[Path, str], command: Command) -> None:
    folder, first = unwritable
    done = command("export", trained, "--out", folder / "p.npz", first=first)
    assert done.returncode == 2, done.stderr
    assert "no permission to write there" in done.stderr and "Traceback" not in done.stderr
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(("form", "suffix"), [("onnx", "onnx"), ("c", "h")])
def test_other_formats(form: str, suffix: str, trained: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(trained)]) == 0
    first = (trained / "policy-export.npz").read_bytes()
    assert main(["export", str(trained / "policy-export.npz"), "--format", form]) == 0
    assert (trained / f"policy-export.{suffix}").stat().st_size > 1000
    assert (trained / "policy-export.npz").read_bytes() == first
    digests = {line.split("SHA-256 ")[1] for line in capsys.readouterr().out.splitlines() if "SHA" in line}
    assert len(digests) == 1  # the same policy in every format


def test_onnx_is_verified(trained: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(trained), "--format", "onnx"]) == 0
    assert main(["export", str(trained / "policy-export.onnx"), "--verify"]) == 0
    assert capsys.readouterr().out.count("golden pairs reproduced") == 2
