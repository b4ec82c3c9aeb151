"""`mjx-cutting serve` as a process: signals, statistics, recording, a full disk, a replaced policy."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mjx_cutting.cli import main
from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.client import Client
from mjx_cutting.deploy.protocol import Mode, Robot, State, Type
from mjx_cutting.deploy.runtime import PolicyRuntime
from mjx_cutting.deploy.stats import ask
from mjx_cutting.trials import read

STILL = (0.0, 0.0, 0.0)
ENV = {
    "teeth": 20, "diameter_m": 0.05, "physics_rate_hz": 500.0, "kerf_m": 0.0016,
    "spindle_speed_rev_s": 19.0, "nominal_feed_m_s": 0.02, "force_noise_n": [0.1, 0.1, 0.18],
    "force_lowpass_hz": 0.0,
}  # fmt: skip


def artefact(seed: int = 0) -> Artefact:
    draw = np.random.default_rng(seed)
    names = (
        "speed_along_path", *(f"{n}_{a}" for n in ("path_error", "velocity", "force") for a in "xyz"),
        "feed_adjustment", "depth", *(f"log_stiffness_{a}" for a in "xyz"),
    )  # fmt: skip
    one = Artefact(
        mean=np.zeros(15), std=np.ones(15), clip=5.0,
        layers=((draw.normal(0, 0.2, (15, 5)).astype(np.float32), np.zeros(5, np.float32)),),
        activation="tanh", observation_names=names, observation_units=("1",) * 15,
        observation_scales=(1.0,) * 15,
        action_names=("stiffness_x", "stiffness_y", "stiffness_z", "feed_adjustment", "depth"),
        action_units=("s^-2", "s^-2", "s^-2", "1", "m"), action_low=(50.0, 50.0, 50.0, -0.8, 0.0),
        action_high=(3000.0, 3000.0, 3000.0, 1.0, 0.002), action_rate_per_s=(4.1, 4.1, 4.1, 4.0, 0.004),
        action_log=(True, True, True, False, False), action_initial=(2450.0, 2080.0, 530.0, 0.0, 0.0),
        policy_period_s=0.02, golden_observation=np.zeros((1, 15)), golden_action=np.zeros((1, 5)),
        provenance={"env": ENV},
    )  # fmt: skip
    return replace(one, golden_action=PolicyRuntime(one)(np.zeros(15))[None])


class Served:
    """A serving process, its log, and a client that drives it."""

    def __init__(self, policy: Path, *options: str, before: str = ""):
        line = [sys.executable, "-m", "mjx_cutting", "serve", str(policy), "--port=0", "--fifo=0", *options]
        line.append("--hold-s=0.4")
        if before:
            line = ["bash", "-c", before + ' && exec "$@"', "bash", *line]
        self.process = subprocess.Popen(line, stderr=subprocess.PIPE, text=True)
        self.log: list[str] = []
        self._thread = threading.Thread(target=self._read)
        self._thread.start()
        self.port = int(self.wait(r"serving on 127.0.0.1:(\d+)")[1])

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.log.append(line)

    def wait(self, pattern: str, seconds: float = 15.0) -> re.Match[str]:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if found := re.search(pattern, "".join(self.log)):
                return found
            if self.process.poll() is not None:
                self._thread.join()
                if found := re.search(pattern, "".join(self.log)):
                    return found
                break
            time.sleep(0.02)
        pytest.fail(f"no {pattern!r} in {''.join(self.log)}")

    def end(self, number: int = signal.SIGTERM) -> int:
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            return self.process.wait(20)
        finally:
            self.process.kill()
            self._thread.join()


@pytest.fixture
def policy(tmp_path: Path) -> Path:
    return artefact().save(tmp_path / "policy.npz")


@pytest.fixture
def serve(policy: Path) -> Iterator[Callable[..., Served]]:
    started: list[Served] = []

    def start(*options: str, before: str = "") -> Served:
        started.append(Served(policy, *options, before=before))
        return started[-1]

    yield start
    for served in started:
        served.end(signal.SIGKILL)


def cut(client: Client, seconds: float, until: Mode | None = None, ask_for: bool = True) -> None:
    draw, begin, cycle = np.random.default_rng(0), time.monotonic(), 0
    while time.monotonic() - begin < seconds:
        force = tuple(draw.normal(0, 1, 3).tolist())
        path = 1.0 + client.sequence * 1e-5
        state = State(17, 0, STILL, STILL, (0.5, 0.3, 0.1), force, 0.02, path, path, 0.0, 19.0)
        client.send_state(state, round(begin * 1e9) + cycle * 2_000_000)  # the sensor's clock is even
        command = client.poll()
        if client.follower is not None:
            client.follower.at(time.monotonic_ns())
        if command is not None and ask_for:
            if command.mode in (Mode.IDLE, Mode.FAULT):
                client.ask(Type.ARM)
            elif command.mode is Mode.ARMED:
                client.ask(Type.START)
        if until is not None and command is not None and command.mode is until:
            return
        cycle += 1
        time.sleep(max(0.0, begin + cycle * 0.002 - time.monotonic()))
    assert until is None, f"no {until!r} within {seconds} s"


def metric(text: str, name: str) -> float:
    found = re.search(rf"^{re.escape(name)} (\S+)$", text, re.MULTILINE)
    assert found, name
    return float(found[1])


def test_a_session_is_served_recorded_and_ended_by_a_ramp(
    serve: Callable[..., Served], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key = tmp_path / "key"
    key.write_text("0123456789abcdef0123456789abcdef\n")
    folder = tmp_path / "trials"
    served = serve(f"--record={folder}", f"--key-file={key}", "--material=mica")
    client = Client("127.0.0.1", served.port, key.read_bytes().strip())
    welcome = client.connect(5.0)
    assert welcome.nominal_feed_m_s == ENV["nominal_feed_m_s"]
    cut(client, 5.0, Mode.RUNNING)
    cut(client, 3.0)
    assert main(["serve", "--stats", f"127.0.0.1:{served.port}"]) == 0
    text = capsys.readouterr().out
    assert metric(text, 'mjx_cutting_mode{mode="running"}') == 1
    assert metric(text, 'mjx_cutting_packets_total{result="accepted"}') > 1000
    assert metric(text, "mjx_cutting_samples_recorded_total") > 1000
    assert metric(text, 'mjx_cutting_latency_seconds_bucket{le="+Inf"}') > 100
    served.process.send_signal(signal.SIGTERM)
    cut(client, 5.0, Mode.IDLE, ask_for=False)
    assert served.end() == 0
    served.wait(r"RUNNING -> SAFE_STOP \(SHUTDOWN\)")
    served.wait(r"SAFE_STOP -> IDLE \(SHUTDOWN\)")
    client.close()
    dataset = read(folder)
    assert dataset.axes == ("+z", "-x", "-y") and {t.material for t in dataset.trials} == {"mica"}
    assert sum(trial.samples for trial in dataset.trials) > 700
    assert {trial.kind for trial in dataset.trials} >= {"cut"}


def test_killed_in_a_cut_the_recording_is_whole_and_the_port_free(
    serve: Callable[..., Served], tmp_path: Path
) -> None:
    folder = tmp_path / "trials"
    served = serve(f"--record={folder}")
    client = Client("127.0.0.1", served.port)
    client.connect(5.0)
    cut(client, 5.0, Mode.RUNNING)
    cut(client, 2.5)
    served.process.kill()
    cut(client, 1.2)
    assert client.follower is not None and client.follower.silent and client.follower.standing
    client.close()
    end = time.monotonic() + 10
    while (folder / ".recording").exists() and time.monotonic() < end:
        time.sleep(0.05)
    assert sum(trial.samples for trial in read(folder).trials) > 500
    again = serve(f"--port={served.port}")  # the last --port counts
    assert again.port == served.port


def test_a_full_disk_ends_the_recording_and_serving_goes_on(
    serve: Callable[..., Served], tmp_path: Path
) -> None:
    served = serve(f"--record={tmp_path / 'trials'}", before="ulimit -f 20")
    client = Client("127.0.0.1", served.port)
    client.connect(5.0)
    cut(client, 5.0, Mode.RUNNING)
    cut(client, 3.0)
    served.wait("recording has stopped")
    served.wait("serving goes on")
    assert client.command is not None and client.command.mode is Mode.RUNNING
    text = ask("127.0.0.1", served.port)
    assert metric(text, "mjx_cutting_samples_not_recorded_total") > 0
    client.ask(Type.STOP)
    cut(client, 5.0, Mode.IDLE, ask_for=False)
    client.close()
    assert served.end() == 1
    served.wait("recording is incomplete")


def test_a_replaced_policy_is_refused_or_taken_whole(serve: Callable[..., Served], policy: Path) -> None:
    served = serve()
    client = Client("127.0.0.1", served.port)
    first = client.connect(5.0).policy_sha256
    cut(client, 5.0, Mode.RUNNING)
    other = artefact(seed=7)
    other.save(policy)
    served.process.send_signal(signal.SIGHUP)
    cut(client, 0.5)
    served.wait("new policy refused in RUNNING")
    assert client.command is not None and client.command.mode is Mode.RUNNING
    client.ask(Type.STOP)
    cut(client, 5.0, Mode.IDLE, ask_for=False)
    whole = policy.read_bytes()
    policy.write_bytes(whole[: len(whole) // 2])
    served.process.send_signal(signal.SIGHUP)
    served.wait("new policy refused, the present one stays")
    policy.write_bytes(whole)
    served.process.send_signal(signal.SIGHUP)
    served.wait(f"new policy {other.sha256[:16]}")
    client.close()
    again = Client("127.0.0.1", served.port)
    assert again.connect(5.0).policy_sha256.hex() == other.sha256 != first.hex()
    again.close()


def test_a_watched_policy_is_taken_when_it_changes(serve: Callable[..., Served], policy: Path) -> None:
    served = serve("--watch")
    other = artefact(seed=7)
    other.save(policy)
    served.wait(f"new policy {other.sha256[:16]}")


def test_no_jax_is_loaded_and_little_memory_used(serve: Callable[..., Served]) -> None:
    served = serve()
    place = Path(f"/proc/{served.process.pid}")
    status = dict(line.split(":", 1) for line in (place / "status").read_text().splitlines())
    assert int(status["VmHWM"].split()[0]) / 1024 < 100
    assert "jax" not in (place / "maps").read_text()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["serve"], "no policy"),
        (["serve", "nothing.npz"], "got no file at nothing.npz"),
        (["serve", "--stats", "localhost"], "expected HOST:PORT"),
        (["serve", "POLICY", "--key-file", "KEY"], "at least 16"),
        (["serve", "POLICY", "--fifo", "120", "--port", "0"], "expected 1 to 99"),
        (["serve", "POLICY", "--record", "OUT", "--session", "KEY", "--port", "0"], "no readable JSON"),
        (["serve", "POLICY", "--hold-s", "7", "--port", "0"], "hold_s"),
    ],
)
def test_bad_input_is_one_line(
    words: list[str], told: str, policy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "key").write_text("short")
    names = {"POLICY": str(policy), "KEY": str(tmp_path / "key"), "OUT": str(tmp_path / "out")}
    assert main([names.get(word, word) for word in words]) == 2
    assert told in capsys.readouterr().err


def test_a_port_that_is_taken_is_said(
    serve: Callable[..., Served], policy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    served = serve()
    assert main(["serve", str(policy), f"--port={served.port}"]) == 2
    assert f"127.0.0.1:{served.port}" in capsys.readouterr().err


def test_a_session_file_describes_what_is_recorded(serve: Callable[..., Served], tmp_path: Path) -> None:
    session = {
        "name": "mine", "tool": {"kind": "slitting_saw", "teeth": 30, "diameter_m": 0.06},
        "sensor": {"sample_rate_hz": 500.0}, "margin_s": 0.1,
        "trial": {"milling": "conventional", "axial_width_m": 0.002, "spindle_speed_rev_s": 25.0},
    }  # fmt: skip
    (tmp_path / "session.json").write_text(json.dumps(session))
    served = serve(f"--record={tmp_path / 'd'}", f"--session={tmp_path / 'session.json'}")
    client = Client("127.0.0.1", served.port)
    client.connect(5.0)
    cut(client, 5.0, Mode.RUNNING)
    cut(client, 1.5)
    client.close()
    assert served.end(signal.SIGINT) == 0
    dataset = read(tmp_path / "d")
    assert dataset.name == "mine" and dataset.tool.teeth == 30
    assert dataset.trials[0].spindle_speed_rev_s == 25.0


def test_flags_of_the_robot_are_those_recorded() -> None:
    from mjx_cutting.trials.parts import HAS_ANGLE, HAS_SPEED

    assert (HAS_ANGLE, HAS_SPEED) == (Robot.SPINDLE_ANGLE, Robot.SPINDLE_SPEED)
