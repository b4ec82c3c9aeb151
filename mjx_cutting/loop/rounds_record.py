"""Trials recorded at the virtual cell: policies served in lock step, and steady probing cuts for tracing.

A probe is an exported policy whose actions do not depend on what it sees: it holds set-points. It is served,
recorded and read back like any other. Tracing reads steady cuts at a known depth; under a compliant arm the
depth is not the set-point, so it is taken from the recorded height of the tool against the nominal surface (a
height error of the sheet is then an error of the depth), over the longest stretch in which depth and feed
hold still.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.export_check import Flight, Lockstep
from mjx_cutting.deploy.protocol import Mode
from mjx_cutting.deploy.recorder import Recorder
from mjx_cutting.deploy.runtime import PolicyRuntime
from mjx_cutting.deploy.virtual_cell import Cell
from mjx_cutting.trials.dataset import Dataset, Trial

NOISE_N = (0.10, 0.18, 0.10)
"""Noise of one sample, process axes: the Axia80's in x, y, z of the base turned."""
FEEDS = (-0.5, 0.0, 0.8)
DEPTHS_M = (0.0006, 0.0012, 0.0019)
PROBE_CUT_M = 0.08
SETTLE_S = 0.8
STEADY_FEED, STEADY_DEPTH, STEADY_M = 0.1, 0.2, 4e-5
SHORTEST_S = 1.3


def probe(like: Artefact, set_point: Sequence[float]) -> Artefact:
    """A policy that holds `set_point` [5], with the format, limits and rates of `like`."""
    low, high = np.asarray(like.action_low), np.asarray(like.action_high)
    log = np.asarray(like.action_log)

    def scale(value: Any) -> np.ndarray:
        value = np.asarray(value, float)
        return np.where(log, np.log(np.where(log, value, 1.0)), value)

    share = 2.0 * (scale(set_point) - scale(low)) / (scale(high) - scale(low)) - 1.0
    bias = np.arctanh(np.clip(share, -0.999999, 0.999999)).astype(np.float32)
    layers = ((np.zeros((like.observation_size, like.action_size), np.float32), bias),)
    golden = np.tile(np.tanh(bias), (len(like.golden_observation), 1))
    return dataclasses.replace(
        like, layers=layers, golden_action=golden, provenance={"probe": [float(v) for v in set_point]}
    )


def probes(like: Artefact, count: int, seed: int) -> list[Artefact]:
    """`count` probes over the feed and depth, stiff enough for the depth to hold; the order is drawn."""
    cells = list(itertools.product(FEEDS, DEPTHS_M))
    draw = np.random.default_rng(seed)
    order = np.concatenate([draw.permutation(len(cells)) for _ in range(-(-count // len(cells)))])[:count]
    stiff = np.asarray(like.action_initial[:3]) * [1.0, 1.0, 2.0]
    gains = np.clip(stiff, like.action_low[:3], like.action_high[:3])
    return [probe(like, [*gains, *cells[k]]) for k in order]


def session(cell: Cell, name: str) -> dict[str, Any]:
    """What the recorder is told about tool, sensor and sheet: what is declared, nothing hidden."""
    config = cell.config
    return {
        "name": name,
        "source": "mjx_cutting.deploy.virtual_cell",
        "licence": "Apache-2.0",
        "tool": {
            "kind": "slitting_saw",
            "teeth": config.teeth,
            "diameter_m": config.diameter_m,
            "helix_rad": 0.0,
        },
        "sensor": {
            "sample_rate_hz": 500.0,
            "noise_std_n": list(NOISE_N),
            "zeroed": "trial",
            "units": "SI",
            "anti_alias": {"kind": "butterworth", "order": 4, "hz": 120.0, "zero_phase": False},
        },
        "trial": {
            "milling": "conventional",
            "material": config.material,
            "axial_width_m": config.kerf_m,
            "tool_id": "saw-1",
            "spindle_speed_rev_s": config.spindle_rev_s,
        },
        "margin_s": SETTLE_S,
    }


def record(cell: Cell, policies: Sequence[Artefact], folder: Path, name: str) -> list[Flight]:
    """Serves each policy once on the cell and records the trials as a dataset in `folder`.

    Raises:
        ValueError: the recording failed.
    """
    recorder = Recorder(folder, session(cell, name))
    lockstep = Lockstep(cell, PolicyRuntime(policies[0]), recorder)
    flights = []
    for policy in policies:
        flights.append(lockstep.fly(PolicyRuntime(policy)))
        recorder.flush(lockstep.server.mode is Mode.RUNNING)
    if not recorder.close():
        raise ValueError(
            f"got {recorder.lost} samples that could not be recorded in {folder}; check the disk"
        )
    return flights


def record_udp(cell: Cell, policies: Sequence[Artefact], folder: Path, name: str) -> list[Flight]:
    """The same over real sockets and in real time: `mjx-cutting serve` records, one process a policy.

    Raises:
        ValueError: a server did not start, or its recording failed.
    """
    from mjx_cutting.deploy.virtual_cell.process import Process

    flights = []
    with tempfile.TemporaryDirectory() as place:
        described = Path(place) / "session.json"
        described.write_text(json.dumps(session(cell, name)))
        for index, policy in enumerate(policies):
            file = policy.save(Path(place) / "policy.npz")
            line = [sys.executable, "-m", "mjx_cutting", "serve", str(file), "--port", "0", "--fifo", "0"]
            line += ["--record", str(folder), "--session", str(described)]
            server = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
            try:
                port = _port(server)
                if index:
                    cell.new_trial()
                process = Process(cell, ("127.0.0.1", port))
                outcome = process.run(longest_s=60.0)
                process.close()
            finally:
                server.send_signal(signal.SIGTERM)
                told, _ = server.communicate(timeout=60)
            if server.returncode:
                raise ValueError(f"got a server that ended with status {server.returncode}: {told[-500:]}")
            flights.append(Flight(outcome.score, tuple(told.splitlines())))
    return flights


def _port(server: subprocess.Popen[str]) -> int:
    assert server.stdout is not None
    for line in server.stdout:
        if line.startswith("serving on "):
            return int(line.rsplit(":", 1)[1])
    raise ValueError("got a policy server that ended before it served; expected one that waits for the cell")


def merged(folders: Sequence[Path], surface_m: float, most: int) -> Dataset:
    """The newest `most` steady cuts of several recordings as one dataset.

    Raises:
        ValueError: a folder holds no dataset, or fewer than two steady cuts are there in all.
    """
    from mjx_cutting.trials import read

    read_ = [read(folder) for folder in folders]
    trials = [
        dataclasses.replace(trial, file=f"{folder.parent.name}-{trial.file}")
        for folder, dataset in zip(folders, read_, strict=True)
        for trial in steady(dataset, surface_m).trials
    ]
    if len(trials) < 2:
        raise ValueError(
            f"got {len(trials)} steady cuts of {SHORTEST_S} s in {len(folders)} recordings; expected at "
            "least 2; record slower or longer cuts"
        )
    return dataclasses.replace(read_[-1], trials=tuple(trials[-most:]))


def steady(dataset: Dataset, surface_m: float) -> Dataset:
    """The dataset's cuts, each cut down to its longest steady stretch at its measured depth and feed.

    Arguments: dataset as recorded; `surface_m` nominal height of the sheet's top. A cut without such a
    stretch is left out.
    """
    kept = [trial for each in dataset.trials if (trial := _stretch(each, surface_m)) is not None]
    return dataclasses.replace(dataset, trials=tuple(kept))


def _stretch(trial: Trial, surface_m: float) -> Trial | None:
    if trial.kind != "cut" or trial.position_m is None or trial.feed_speed_measured_m_s is None:
        return None
    rate = (len(trial.time_s) - 1) / (trial.time_s[-1] - trial.time_s[0])
    turn = max(1, round(rate / trial.spindle_speed_rev_s))
    kernel = np.ones(4 * turn) / (4 * turn)
    # what the process axes call y is into the sheet, the base's -z
    depth = np.convolve(surface_m - trial.position_m[:, 2], kernel, "same")
    feed = np.convolve(trial.feed_speed_measured_m_s, kernel, "same")
    middle = slice(4 * turn, -4 * turn)
    typical_m, typical_m_s = np.median(depth[middle]), np.median(feed[middle])
    still = (np.abs(depth - typical_m) < max(STEADY_M, STEADY_DEPTH * typical_m)) & (
        np.abs(feed - typical_m_s) < STEADY_FEED * typical_m_s
    )
    still[: 2 * turn] = still[-2 * turn :] = False
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    if not len(edges):
        return None
    starts, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - starts))
    part = slice(int(starts[longest]), int(ends[longest]))
    if (part.stop - part.start) / rate < SHORTEST_S or depth[part].mean() <= 0.0:
        return None
    records = ("time_s", "force_n", "position_m", "spindle_angle_rad", "spindle_speed_measured_rev_s",
               "feed_speed_measured_m_s")  # fmt: skip
    cut = {name: value[part] for name in records if (value := getattr(trial, name)) is not None}
    cut["time_s"] = cut["time_s"] - cut["time_s"][0]
    return dataclasses.replace(
        trial,
        feed_speed_m_s=float(np.mean(trial.feed_speed_measured_m_s[part])),
        radial_depth_m=float(np.mean(surface_m - trial.position_m[part, 2])),
        **cut,
    )
