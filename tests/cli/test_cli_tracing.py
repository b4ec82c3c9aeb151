"""`trace` and `fit-gp`: the verdict printed and written; bad input told, with nothing half written."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from mjx_cutting.cli import main
from mjx_cutting.trials import write
from mjx_cutting.trials.dataset import Sensor, ToolInfo
from mjx_cutting.trials.synthetic import Conditions, Hidden, Sheet, make_trials

Command = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four slots by a two-tooth mill with 10 um of runout that nobody declares."""
    made = make_trials(
        ToolInfo("end_mill", 2, 0.02),
        Sheet((9e8, 2.4e8, 1.4e8), (1.6e4, 2e4, 1.8e4)),
        [Conditions(50.0, feed, 0.02, 0.002) for feed in (0.002, 0.005, 0.008, 0.011)],
        Sensor(2000.0, (0.5, 0.5, 0.5)),
        hidden=Hidden(runout_m=1e-5),
        duration_s=0.6,
        seed=1,
    )
    return write(made, tmp_path_factory.mktemp("data") / "mill")


@pytest.mark.slow
def test_trace_then_fit(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = [
        "trace",
        str(dataset),
        "--effects",
        "radial_runout",
        "unequal_pitch",
        "--out",
        str(tmp_path / "t"),
    ]
    assert main(words) == 0
    shown = capsys.readouterr().out
    verdict = json.loads((tmp_path / "t" / "verdict.json").read_text())
    assert [effect["name"] for effect in verdict["effects"]] == ["radial_runout"]
    assert f"{verdict['verdict']}: held-out error" in shown and "runner-up unequal_pitch" in shown
    assert verdict["after"]["heldout_nrmse"] < 0.5 * verdict["before"]["heldout_nrmse"]
    names = sorted(path.name for path in (tmp_path / "t").iterdir())
    results = ["isolability.json", "model.json", "report.html", "verdict.json"]
    assert names == sorted(["config.json", "versions.json", *results])
    model = ["--model", str(tmp_path / "t" / "model.json")]
    assert main(["fit-gp", str(dataset), *model, "--out", str(tmp_path / "g")]) == 0
    shown = capsys.readouterr().out
    assert "period " in shown and "over 4 trials" in shown
    assert (tmp_path / "g" / "gp.npz").is_file() and (tmp_path / "g" / "disturbance.json").is_file()
    assert main(["fit-gp", str(dataset), *model, "--out", str(tmp_path / "g")]) == 2
    assert "holds something already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--effects", "gravity_of_mars"], "unknown effect 'gravity_of_mars'"),
        (["--band", "50", "10"], "band is 50 to 10 Hz"),
        (["--band", "0", "1e6"], "band is 0 to 1e+06 Hz"),
    ],
)
def test_bad_options_leave_nothing(
    words: list[str], told: str, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["trace", str(dataset), *words, "--out", str(tmp_path / "t")]) == 2
    assert told in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("verb", ["trace", "fit-gp"])
def test_no_dataset(verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([verb, str(tmp_path / "none"), "--out", str(tmp_path / "t")]) == 2
    assert "expected slotting, drilling or a dataset folder" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_model_that_is_none(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["fit-gp", str(dataset), "--model", str(dataset / "dataset.json"), "--out", str(tmp_path / "g")]
    assert main(words) == 2
    assert "expected" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_warp_without_time_is_refused(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["fit-gp", str(dataset), "--clock", "angle", "--warp", "--out", str(tmp_path / "g")]
    assert main(words) == 2
    assert "error: " in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("verb", ["trace", "fit-gp"])
def test_unwritable_folder_is_found_before_the_work(
    verb: str, dataset: Path, unwritable: tuple[Path, str], command: Command
) -> None:
    folder, first = unwritable
    done = command(verb, dataset, "--out", folder / "run", first=first)
    assert done.returncode == 2, done.stderr
    assert "no permission to write there" in done.stderr and "Traceback" not in done.stderr
    assert list(folder.iterdir()) == []
