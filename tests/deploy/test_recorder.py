"""The recording process: a dataset comes out whatever dies, and the server never waits for it."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjx_cutting.deploy.protocol import State
from mjx_cutting.deploy.recorder import Recorder
from mjx_cutting.trials import read
from mjx_cutting.trials.parts import RECORDING, recover

SESSION: dict[str, Any] = {
    "name": "recorded",
    "tool": {"kind": "slitting_saw", "teeth": 20, "diameter_m": 0.05},
    "sensor": {"sample_rate_hz": 500.0},
    "trial": {"milling": "conventional", "axial_width_m": 0.0016, "spindle_speed_rev_s": 19.0},
}
SET_POINT = np.array([1000.0, 1000.0, 1000.0, 0.0, 0.001])


def feed(recorder: Recorder, seconds: float, trial: int, start: int = 0) -> None:
    draw = np.random.default_rng(trial)
    for k in range(start, start + round(500 * seconds)):
        force = tuple(draw.normal(0, 1, 3).tolist())
        state = State(
            17, 0, (0.0, 0.0, 0.0), (0.0, -0.0125, 0.0), (0.5, 0.3, 0.1), force, 0.0125, 0.0, 0.0, 0.0, 19.0
        )
        recorder((trial * 10**12) + k * 2_000_000, state, SET_POINT, trial)
        if k % 10 == 9:
            recorder.flush(running=True)
    recorder.flush(running=True)


def wait_for(what: Any, seconds: float = 10.0) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


def test_trials_come_out_as_they_went_in(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "d", SESSION)
    feed(recorder, 2.0, trial=1)
    recorder.flush(running=False)
    feed(recorder, 1.5, trial=2)
    assert recorder.close() and recorder.taken == 1750
    dataset = read(tmp_path / "d")
    assert [trial.samples for trial in dataset.trials] == [1000, 750]
    forces = np.random.default_rng(2).normal(0, 1, (750, 3))
    np.testing.assert_allclose(dataset.trials[1].force_n[:, 2], forces[:, 0], rtol=0, atol=1e-9)


def test_the_recorder_killed_leaves_all_but_the_last_second(tmp_path: Path) -> None:
    folder = tmp_path / "d"
    recorder = Recorder(folder, SESSION)
    feed(recorder, 3.4, trial=1)
    wait_for(lambda: len(list(folder.glob(f"{RECORDING}/0001/[0-9]*"))) == 3)
    recorder._child.kill()
    recorder._child.wait()
    (trial,) = read(folder).trials
    assert trial.samples == 1500
    feed(recorder, 0.1, trial=1, start=1700)
    assert recorder.failed and recorder.lost == 50 and recorder.news() and recorder.news() is None
    assert not recorder.close()


SERVER = """
import json, pathlib, sys, time
import numpy as np
from mjx_cutting.deploy.protocol import State
from mjx_cutting.deploy.recorder import Recorder
recorder = Recorder(pathlib.Path(sys.argv[1]), json.loads(sys.argv[2]))
for k in range(1234):
    force = (float(k % 7), k * 0.01, 1.0 / (k + 1))
    state = State(17, 0, (0.0,) * 3, (0.0,) * 3, (0.5, 0.3, 0.1), force, 0.0125, 0.0, 0.0, 0.0, 19.0)
    recorder(k * 2_000_000, state, np.ones(5) * 0.001, 1)
    recorder.flush(running=True)
print("fed", flush=True)
time.sleep(60)
"""


def test_the_server_killed_leaves_everything_it_took(tmp_path: Path) -> None:
    folder = tmp_path / "d"
    line = [sys.executable, "-c", SERVER, str(folder), json.dumps(SESSION)]
    with subprocess.Popen(line, stdout=subprocess.PIPE) as server:
        assert server.stdout is not None and server.stdout.readline() == b"fed\n"
        server.send_signal(signal.SIGKILL)
    wait_for(lambda: (folder / "dataset.json").exists() and not (folder / RECORDING).exists())
    (trial,) = read(folder).trials
    assert trial.samples == 1234


def test_a_full_disk_stops_recording_and_nothing_else(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A limit on the size of a file stands for the full disk: the write fails in the same place."""
    folder = tmp_path / "d"
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))  # a part has some 60 kB
    try:
        recorder = Recorder(folder, SESSION)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    feed(recorder, 1.1, trial=1)
    recorder._child.wait(10)
    longest = 0.0
    for k in range(200):
        start = time.perf_counter()
        feed(recorder, 0.02, trial=1, start=600 + 10 * k)
        longest = max(longest, time.perf_counter() - start)
    assert recorder.failed and recorder.lost >= 2000 - 10
    assert longest < 0.05
    assert "recording has stopped" in capfd.readouterr().err
    assert not recorder.close()
    assert recover(folder) == []  # nothing was whole, nothing is left behind
    assert not (folder / RECORDING).exists()


def test_a_stuck_recorder_never_blocks_and_what_is_lost_is_counted(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "d", SESSION)
    wait_for(lambda: (tmp_path / "d" / RECORDING / "session.json").exists())
    os.kill(recorder._child.pid, signal.SIGSTOP)
    start = time.perf_counter()
    state = State(17, 0, *((0.0, 0.0, 0.0),) * 4, 0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(60_000):  # two minutes
        recorder(k, state, SET_POINT, 1)
        if k % 10 == 9:
            recorder.flush(running=True)
    assert time.perf_counter() - start < 5.0
    assert recorder.lost > 0 and recorder.taken + recorder.lost == 60_000
    start = time.perf_counter()
    assert not recorder.close(timeout_s=0.3)
    assert time.perf_counter() - start < 2.0
    recorder._child.kill()
    recorder._child.wait()
