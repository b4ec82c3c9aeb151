"""`mjx-cutting bench`: table, figures and picture; the wheel's own code, without the benchmarks folder."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mjx_cutting.cli import main
from mjx_cutting.sim import throughput, throughput_figure


def test_table_figures_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--batches", "8", "--seconds", "0.05", "--no-peers", "--no-compile-times"]
    files = ["--json", str(tmp_path / "r.json"), "--plot", str(tmp_path / "r.png")]
    assert main(["bench", *words, *files]) == 0
    shown = capsys.readouterr().out
    assert "| mjx-cutting, fused | 8 |" in shown and "state of one environment" in shown
    result = json.loads((tmp_path / "r.json").read_text())
    rates = result["rates"]["fused"]
    assert set(rates) == {"8"} and result["physics_steps_per_s"] == rates["8"]["physics_steps_per_s"]
    assert result["physics_steps_per_s"] * rates["8"]["microseconds_per_step"] == pytest.approx(1e6)
    assert result["versions"]["jax"] and result["machine"]["cores"] >= 1
    # the state goes in and comes out of one call
    assert rates["8"]["bytes_per_environment"] > 2 * 0.9 * result["state_bytes_per_environment"]
    assert (tmp_path / "r.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--batches", "0"], "at least 1"),
        (["--seconds", "-1"], "above 0 s"),
        (["--plot", "x.txt"], r".png, .svg or .pdf"),
    ],
)
def test_what_does_not_fit_is_one_line(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", *words]) == 2
    assert told in capsys.readouterr().err


@pytest.mark.slow
def test_peers_run_in_the_same_run(tmp_path: Path) -> None:
    result = throughput.compare((64,), seconds=0.3, first_call=False)
    assert result["ratio_vs_gym_two_processes"] > 1.0  # tens, on a quiet machine
    assert result["peers"]["rollout_one_thread"] > result["peers"]["gym_one_process"]
    assert throughput_figure.draw(result, tmp_path / "r.svg").read_text().count("Gymnasium") >= 1
