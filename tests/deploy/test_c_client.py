"""The controller-side example in C: built without a warning, and whole cuts between server and cell."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.c_header import write_c_header
from mjx_cutting.deploy.observing import ACTIONS, NAMES

DEPLOY = Path(str(resources.files("mjx_cutting.deploy")))
SOURCE = DEPLOY / "examples" / "fri_client.c"
COMPILER = shutil.which("gcc")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="no gcc on this machine")


def policy(depth_m: float) -> Artefact:
    """A policy that holds stiff gains, one and a half times the nominal feed, and a depth."""
    low, high = np.array([50.0, 50.0, 50.0, -0.8, 0.0]), np.array([3000.0, 3000.0, 3000.0, 1.0, 0.002])
    share = np.array([0.9, 0.9, 0.6, 1.3 / 1.8, depth_m / 0.002])
    bias = np.arctanh(2.0 * share - 1.0).astype(np.float32)
    return Artefact(
        mean=np.zeros(15), std=np.ones(15), clip=5.0, layers=((np.zeros((15, 5)), bias),), activation="tanh",
        observation_names=NAMES, observation_units=("1",) * 15, observation_scales=(1.0,) * 15,
        action_names=ACTIONS, action_units=("s^-2", "s^-2", "s^-2", "1", "m"), action_low=tuple(low),
        action_high=tuple(high), action_rate_per_s=(4.1, 4.1, 4.1, 2.0, 0.002),
        action_log=(True, True, True, False, False), action_initial=(2450.0, 2080.0, 530.0, 0.0, 0.0),
        policy_period_s=0.02, golden_observation=np.zeros((1, 15)), golden_action=np.tanh(bias)[None],
    )  # fmt: skip


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("client")
    artefact = policy(0.001)
    artefact.save(folder / "policy.npz")
    policy(0.0005).save(folder / "other.npz")
    write_c_header(artefact, folder / "policy.h")
    program = folder / "fri_client"
    line = [
        str(COMPILER),
        "-std=c99",
        "-O2",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-I",
        str(DEPLOY),
        "-I",
        str(folder),
    ]
    done = subprocess.run(
        [*line, str(SOURCE), "-o", str(program), "-lm"], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return program


@contextmanager
def serving(file: Path) -> Iterator[tuple[subprocess.Popen[str], int]]:
    line = [sys.executable, "-m", "mjx_cutting", "serve", str(file), "--port", "0", "--fifo", "0"]
    server = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert server.stdout is not None
        for told in server.stdout:
            if told.startswith("serving on "):
                break
        else:
            raise AssertionError("the server did not start")
        yield server, int(told.rsplit(":", 1)[1])
    finally:
        if server.poll() is None:
            server.send_signal(signal.SIGTERM)
        server.communicate(timeout=30)


def start(client: Path, port: int) -> tuple[subprocess.Popen[str], int]:
    program = subprocess.Popen(
        [str(client), str(port)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    assert program.stdout is not None
    return program, int(program.stdout.readline().rsplit(" ", 1)[1])


def cell(port: int) -> subprocess.CompletedProcess[str]:
    line = [
        sys.executable,
        "-m",
        "mjx_cutting",
        "cell",
        "--server",
        f"127.0.0.1:{port}",
        "--material",
        "plastic",
    ]
    line += ["--approach-m", "0.004", "--cut-m", "0.03", "--longest-s", "40"]
    return subprocess.run(line, capture_output=True, text=True, timeout=120)


@pytest.mark.slow
def test_a_whole_cut_through_c(client: Path) -> None:
    with serving(client.parent / "policy.npz") as (_, port):
        program, robot_port = start(client, port)
        done = cell(robot_port)
        told, _ = program.communicate(timeout=30)
    assert done.returncode == 0, done.stdout + done.stderr + told
    score = json.loads(done.stdout)["score"]
    assert score["completed"] and score["mrv_mm3"] > 5.0 and score["worst_deviation_mm"] < 5.0
    assert program.returncode == 0 and "0 refused" in told and "ended idle" in told


@pytest.mark.slow
def test_the_server_dies_in_the_cut(client: Path) -> None:
    with serving(client.parent / "policy.npz") as (server, port):
        program, robot_port = start(client, port)
        line = [sys.executable, "-m", "mjx_cutting", "cell", "--server", f"127.0.0.1:{robot_port}"]
        line += ["--material", "plastic", "--approach-m", "0.004", "--cut-m", "0.2", "--longest-s", "40"]
        running = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert server.stdout is not None
        for told in server.stdout:
            if "-> RUNNING" in told:
                break
        with pytest.raises(subprocess.TimeoutExpired):
            running.wait(2.0)
        server.kill()
        shown, _ = running.communicate(timeout=60)
        told, _ = program.communicate(timeout=30)
    outcome = json.loads(shown)
    assert outcome["phase"] == "clear" and not outcome["score"]["completed"]
    assert 0.0 < outcome["score"]["path_m"] < 0.15
    assert program.returncode == 1 and "ended silent" in told


@pytest.mark.slow
def test_another_policy_is_refused(client: Path) -> None:
    with serving(client.parent / "other.npz") as (_, port):
        program, _ = start(client, port)
        told, _ = program.communicate(timeout=30)
    assert program.returncode == 4 and "another policy" in told
