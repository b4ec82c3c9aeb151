"""`mjx-cutting sim`: what an episode came to, its pictures, its folder; what does not fit is one line."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from mjx_cutting.cli import main
from mjx_cutting.cli.sim import Sim
from mjx_cutting.sim import EnvConfig
from mjx_cutting.sim import config as configs


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """A path of 12 mm instead of 250."""

    def make(**changes: object) -> EnvConfig:
        return EnvConfig(**{"approach_m": 0.002, "cut_m": 0.01, "depth_rate_m_s": 0.02, **changes})  # type: ignore[arg-type]

    monkeypatch.setattr("mjx_cutting.sim.EnvConfig", make, raising=False)
    assert configs.EnvConfig is EnvConfig


def test_the_baseline_is_told_and_kept_with_its_settings(
    short: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    assert main(["sim", "--material", "plastic", "--seed", "3", "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("plastic: completed\n") and "mm^3" in shown and str(out) in shown
    told = json.loads((out / "episode.json").read_text())
    assert told["time_s"] == pytest.approx(0.012 / 0.0125, abs=0.03)
    assert 0.0 < told["mrv_mm3"] < 16.0 and 1.0 < told["load_n"] < 30.0
    assert json.loads((out / "config.json").read_text())["seed"] == 3


def test_pictures_and_figures_are_of_one_episode(short: None, tmp_path: Path) -> None:
    from PIL import Image

    still, video = tmp_path / "a" / "still.png", tmp_path / "b" / "cut.gif"
    told = Sim(material="foam", still=still, at_s=0.5, render=video)._play()
    assert np.asarray(Image.open(still)).std() > 20.0
    film = Image.open(video)
    assert getattr(film, "n_frames", 0) > 15 and np.asarray(film.convert("RGB")).std() > 20.0
    assert told["ended"] == "completed" and told["material"] == "foam"
    assert [path.name for path in video.parent.iterdir()] == ["cut.gif"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--render", "cut.avi"], r"\.mp4 or \.gif"),
        (["--still", "cut.jpg"], r"\.png"),
        (["--speed", "0"], "above 0"),
        (["--material", "model"], "without --model"),
        (["--policy", "nowhere"], "nowhere"),
        (["--gp", "none.npz"], "fit-gp"),
        (["--view"], "no display"),
    ],
)
def test_what_does_not_fit_is_one_line(
    words: list[str],
    told: str,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert main(["sim", *words]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert re.search(told, error) and list(tmp_path.iterdir()) == []


def test_a_policy_of_another_task_is_refused(trained: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", "--policy", str(trained)]) == 2
    assert "expected 15 and 5" in capsys.readouterr().err
