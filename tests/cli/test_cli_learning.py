"""`train`, `evaluate` and `export` in a row at toy size, and Ctrl-C in the middle of a training."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from mjx_cutting.cli import main
from mjx_cutting.deploy import PolicyRuntime
from mjx_cutting.learning import load_policy


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A training of the smallest size."""
    folder = tmp_path_factory.mktemp("runs") / "expert"
    assert main(["train", "--preset", "smoke", "--seed", "3", "--out", str(folder), "--quiet"]) == 0
    return folder


@pytest.mark.slow
def test_training_leaves_settings_metrics_and_policy(run: Path) -> None:
    config = json.loads((run / "config.json").read_text())
    assert config["verb"] == "train" and config["seed"] == 3
    assert config["config"]["ppo"]["steps"] == 512 and config["config"]["env"]["kerf_m"] == 0.0016
    assert len((run / "metrics.jsonl").read_text().splitlines()) == 4
    assert load_policy(run).observation_size == 15


@pytest.mark.slow
def test_second_training_into_the_same_folder_is_refused(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (run / "policy.npz").read_bytes()
    assert main(["train", "--preset", "smoke", "--out", str(run), "--quiet"]) == 2
    assert "holds a run already" in capsys.readouterr().err
    assert (run / "policy.npz").read_bytes() == before


@pytest.mark.slow
def test_evaluation_tells_of_policy_and_baseline(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["evaluate", str(run), "--rollouts", "2", "--out", str(tmp_path / "e")]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"baseline +-?\d", shown) and re.search(r"expert +-?\d", shown)
    assert (tmp_path / "e" / "evaluation.json").is_file() and (tmp_path / "e" / "reward.png").is_file()


@pytest.mark.slow
def test_export_runs_without_the_training(run: Path, tmp_path: Path) -> None:
    assert main(["export", str(run), "--out", str(tmp_path / "policy.npz")]) == 0
    runtime = PolicyRuntime.load(tmp_path / "policy.npz")
    policy = load_policy(run)
    scale = np.asarray(policy.description.observation_scales)
    for observation in np.random.default_rng(0).normal(size=(20, 15)):
        expected = np.asarray(policy.apply(observation.astype(np.float32)))
        np.testing.assert_allclose(runtime(observation * scale), expected, atol=1e-4)


@pytest.mark.slow
def test_ctrl_c_keeps_a_whole_checkpoint_to_go_on_from(tmp_path: Path) -> None:
    folder = tmp_path / "expert"
    words = ["train", "--preset", "smoke", "--steps", "1000000", "--out", str(folder), "--quiet"]
    process = subprocess.Popen(
        [sys.executable, "-m", "mjx_cutting", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 300
    while not (folder / "metrics.jsonl").exists() and time.monotonic() < deadline and process.poll() is None:
        time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=120)
    assert process.returncode == 130, told
    assert "Traceback" not in told and f"go on with --resume {folder}" in told
    (checkpoint,) = (folder / "checkpoints").iterdir()
    done = int(checkpoint.name)
    assert load_policy(folder).observation_size == 15
    steps = str(128 * (done + 2))
    assert main(["train", "--resume", str(folder), "--steps", steps, "--quiet"]) == 0
    lines = [json.loads(line) for line in (folder / "metrics.jsonl").read_text().splitlines()]
    assert [line["iteration"] for line in lines] == list(range(1, done + 3))
