"""`mjx-cutting cell`: a cut in lock step, bad input, and silence where there is no server."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mjx_cutting.cli import main
from mjx_cutting.deploy.artefact import Artefact

SHORT = ("--approach-m", "0.002", "--cut-m", "0.01")


def holding(path: Path) -> Path:
    """An exported policy that holds set-points in the middle of their ranges."""
    names = ("stiffness_x", "stiffness_y", "stiffness_z", "feed_adjustment", "depth")
    artefact = Artefact(
        mean=np.zeros(1), std=np.ones(1), clip=5.0, layers=((np.zeros((1, 5)), np.zeros(5)),),
        activation="tanh", observation_names=("force_y",), observation_units=("N",),
        observation_scales=(1.0,),
        action_names=names, action_units=("s^-2", "s^-2", "s^-2", "1", "m"),
        action_low=(1000.0, 1000.0, 300.0, -0.8, 0.0), action_high=(3000.0, 3000.0, 3000.0, 1.0, 0.002),
        action_rate_per_s=(4.1, 4.1, 4.1, 2.0, 0.002), action_log=(True, True, True, False, False),
        action_initial=(2450.0, 2080.0, 530.0, 0.0, 0.0), policy_period_s=0.02,
        golden_observation=np.zeros((1, 1)), golden_action=np.zeros((1, 5)),
    )  # fmt: skip
    return artefact.save(path)


def test_cuts_in_lock_step(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    policy = holding(tmp_path / "p.npz")
    assert main(["cell", "--fast", str(policy), "--material", "plastic", *SHORT, "--trials", "2"]) == 0
    first, second = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert first["score"]["completed"] and second["score"]["completed"]
    assert first["score"]["mrv_mm3"] > 1.0 and "ARMED -> RUNNING" in first["log"]
    assert first["score"]["load_n"] != second["score"]["load_n"]  # another phase of the spindle
    assert main(["cell", "--fast", str(policy), *SHORT, "--longest-s", "1"]) == 1


def test_nobody_answers(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cell", "--server", "127.0.0.1:9", "--longest-s", "0.3"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["phase"] == "holding" and told["score"]["time_s"] == 0.0


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--material", "oak"), "expected one of foam, plastic"),
        (("--server", "nowhere"), "expected HOST:PORT"),
        (("--effects", "missing.toml"), "cannot be read as TOML"),
        (("--trials", "0"), "expected at least 1"),
        (("--cut-m", "9"), "expected 0.001 to 0.5"),
        (("--fast", "missing.npz"), "expected an exported policy"),
    ],
)
def test_bad_input(words: tuple[str, ...], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cell", *words]) == 2
    assert told in capsys.readouterr().err
