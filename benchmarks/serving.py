"""How late the policy server is, and how late other engines would be, in one run on this machine.

    python benchmarks/serving.py [--quick] [--minutes 10] [--json FILE]

The server is `mjx-cutting serve` itself, driven over loopback through a whole cut by a controller at 500 Hz,
with a policy of 3 x 128 units, once at 50 Hz and once at 500 Hz. Its latency is from the time a COMMAND was
due until it was sent. Then three engines alone (ours in NumPy, onnxruntime with one thread and no spinning,
jitted JAX) wake at the same paces, run the same policy once, and are timed from when they were due; "nothing"
wakes and does nothing, which is what the machine itself adds. All ask for SCHED_FIFO 50 and stand on one
core, while another process keeps the other core busy; the run says where FIFO was refused, and how long the
host of a virtual machine kept that core for others (stolen). Last, hostile packets are given to the server's
packet handling; beside each cut, some go to the process over its socket.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import json
import multiprocessing
import os
import re
import select
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mjx_cutting import _files, _platform
from mjx_cutting.deploy import hostile, protocol, realtime
from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.client import Client
from mjx_cutting.deploy.latency import Histogram
from mjx_cutting.deploy.observing import ACTIONS, NAMES
from mjx_cutting.deploy.protocol import Mode, Robot, State, Type
from mjx_cutting.deploy.runtime import PolicyRuntime
from mjx_cutting.deploy.server import Server, Settings
from mjx_cutting.deploy.stats import ask

# isort: split
import numpy as np

FIFO = 50
STATE_RATE_HZ = 500.0
ENGINES = ("nothing", "numpy", "onnxruntime", "jax")
IMPORT = (
    "import time; t = time.perf_counter()\nimport mjx_cutting.deploy.service\nprint(time.perf_counter() - t)"
)


def main() -> None:
    """Parse the command line, measure, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="10 s a figure, 100,000 hostile packets")
    parser.add_argument("--minutes", type=float, default=10.0, help="of each serving run; a tenth an engine")
    parser.add_argument("--json", type=Path, help="write all figures to this file")
    parser.add_argument("--engine", nargs=4, metavar=("NAME", "POLICY", "HZ", "S"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.engine:
        name, policy, rate, seconds = given.engine
        print(json.dumps(engine(name, Path(policy), float(rate), float(seconds))))
        return
    seconds = 10.0 if given.quick else 60.0 * given.minutes
    result = measure(seconds, 10.0 if given.quick else seconds / 10, 100_000 if given.quick else 1_000_000)
    if given.json:
        _files.write_atomic(given.json, json.dumps(result, indent=2) + "\n")


def measure(seconds: float, engine_seconds: float, hostile_packets: int) -> dict[str, Any]:
    """Returns all figures, and prints them as they come."""
    cores = sorted(os.sched_getaffinity(0))
    result: dict[str, Any] = {"seconds": seconds, "cores": len(cores), "versions": _platform.versions()}
    result["import_s"] = min(float(run([sys.executable, "-c", IMPORT])) for _ in range(3))
    print(f"import {result['import_s']:.2f} s", flush=True)
    load = multiprocessing.get_context("spawn").Process(target=spin, args=(cores[-1],), daemon=True)
    with tempfile.TemporaryDirectory() as folder:
        load.start()
        try:
            for rate_hz in (50, 500):
                policy = artefact(1 / rate_hz).save(Path(folder) / f"{rate_hz}.npz")
                before = stolen_s(cores[0])
                served = serve(policy, seconds, cores)
                served["stolen_s"] = round(stolen_s(cores[0]) - before, 2)
                print(row(f"server at {rate_hz} Hz", served), flush=True)
                result[f"server_{rate_hz}_hz"] = served
            for rate_hz, name in itertools.product((50, 500), ENGINES):
                line = [sys.executable, __file__, "--engine", name, str(policy), str(rate_hz)]
                before = stolen_s(cores[0])
                found = json.loads(run([*line, str(engine_seconds)], core=cores[0]).splitlines()[-1])
                found["stolen_s"] = round(stolen_s(cores[0]) - before, 2)
                print(row(f"{name} alone at {rate_hz} Hz", found), flush=True)
                result[f"{name}_{rate_hz}_hz"] = found
        finally:
            load.terminate()
            load.join()
    result |= attack(hostile_packets)
    print(
        f"{result['hostile_packets']} hostile packets: acted on {result['acted_on']}, memory grew by "
        f"{result['hostile_memory_mb']:.2f} MB, {result['hostile_us']:.1f} us each"
    )
    served = result["server_50_hz"]
    result["acted_on"] += served["acted_on"] + result["server_500_hz"]["acted_on"]
    return result | {
        "p50_us": served["p50_us"],
        "p999_us": served["p999_us"],
        "missed_deadlines": served["missed"],
        "rss_mb": max(served["rss_mb"], result["server_500_hz"]["rss_mb"]),
    }


def artefact(period_s: float) -> Artefact:
    """A policy with random weights in three layers of 128, and the task's names and limits."""
    draw = np.random.default_rng(0)
    widths = (len(NAMES), 128, 128, 128, len(ACTIONS))
    layers = tuple(
        ((draw.standard_normal(pair) / np.sqrt(pair[0])).astype(np.float32), np.zeros(pair[1], np.float32))
        for pair in itertools.pairwise(widths)
    )
    one = Artefact(
        mean=np.zeros(15), std=np.ones(15), clip=5.0, layers=layers, activation="swish",
        observation_names=NAMES, observation_units=("SI",) * 15,
        observation_scales=(0.0125, *(0.01,) * 3, *(0.0125,) * 3, *(10.0,) * 3, 1.0, 0.001, *(6.0,) * 3),
        action_names=ACTIONS, action_units=("s^-2", "s^-2", "s^-2", "1", "m"),
        action_low=(50.0, 50.0, 50.0, -0.8, 0.0), action_high=(3000.0, 3000.0, 3000.0, 1.0, 0.002),
        action_rate_per_s=(4.1, 4.1, 4.1, 2.0, 0.002), action_log=(True, True, True, False, False),
        action_initial=(2450.0, 2080.0, 530.0, 0.0, 0.0), policy_period_s=period_s,
        golden_observation=np.zeros((1, 15)), golden_action=np.zeros((1, 5)),
    )  # fmt: skip
    return dataclasses.replace(one, golden_action=PolicyRuntime(one)(np.zeros(15))[None])


def serve(policy: Path, seconds: float, cores: list[int]) -> dict[str, Any]:
    """Drives a serving process through a cut of so many seconds; its own figures."""
    line = [sys.executable, "-m", "mjx_cutting", "serve", str(policy), "--port=0", f"--fifo={FIFO}"]
    process = subprocess.Popen(
        line, stderr=subprocess.PIPE, text=True, preexec_fn=lambda: os.sched_setaffinity(0, cores[:1])
    )
    try:
        assert process.stderr is not None
        told, port = [], None
        while port is None:
            text = process.stderr.readline()
            if not text:
                raise RuntimeError(f"the server did not start: {' '.join(told)}")
            told.append(text.strip())
            found = re.search(r"serving on [\d.]+:(\d+)", text)
            port = int(found[1]) if found else None
        sent, stopped_s = drive(port, seconds, cores)
        text = ask("127.0.0.1", port)
        memory = dict(
            one.split(":", 1) for one in Path(f"/proc/{process.pid}/status").read_text().splitlines()
        )
    finally:
        process.terminate()
        process.wait(30)
    value = {name: float(number) for name, number in re.findall(r"^(mjx_\S+) (\S+)$", text, re.MULTILINE)}
    quantile = 'mjx_cutting_latency_quantile_seconds{quantile="%s"}'
    return {
        **{
            name: round(1e6 * value[quantile % q], 1)
            for name, q in (("p50_us", "0.5"), ("p99_us", "0.99"), ("p999_us", "0.999"), ("max_us", "1"))
        },
        "count": int(value["mjx_cutting_latency_seconds_count"]),
        "missed": int(value["mjx_cutting_deadlines_missed_total"]),
        "held": int(value["mjx_cutting_held_total"]),
        "rss_mb": round(int(memory["VmHWM"].split()[0]) / 1024, 1),
        "fifo": next(one for one in told if one.startswith("SCHED_FIFO")),
        "ran_through": stopped_s == 0.0,
        "stopped_s": round(stopped_s, 3),
        "acted_on": max(0, int(value['mjx_cutting_packets_total{result="accepted"}']) - sent),
    }


def drive(port: int, seconds: float, cores: list[int]) -> tuple[int, float]:
    """The controller: (packets sent, s in which a cut once begun stood still). A cut that the server stopped
    is begun again. Hostile packets go beside it."""
    realtime.request(FIFO - 10)
    os.sched_setaffinity(0, cores[-1:])
    client = Client("127.0.0.1", port)
    enemy = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        client.connect()
        still = (0.0, 0.0, 0.0)
        state = State(Robot.READY, 0, still, still, still, (1.0, -8.0, 3.0), 0.0125, 0.0, 0.0, 0.0, 0.0)
        good = [protocol.encode(Type.STATE, state, session=1, sequence=9, challenge=5, time_ns=1)]
        attackers = hostile.packets(good)
        begin, cycle, begun, stood = time.monotonic(), 0, False, 0
        while time.monotonic() - begin < seconds:
            client.send_state(state)
            running = client.command is not None and client.command.mode is Mode.RUNNING
            begun, stood = begun or running, stood + (begun and not running)
            if cycle % 25 == 0:
                enemy.sendto(next(attackers), ("127.0.0.1", port))
            command = client.poll()
            if command is not None and command.mode is Mode.IDLE:
                client.ask(Type.ARM)
            elif command is not None and command.mode is Mode.ARMED:
                client.ask(Type.START)
            cycle += 1
            time.sleep(max(0.0, begin + cycle / STATE_RATE_HZ - time.monotonic()))
        return client.sequence, stood / STATE_RATE_HZ if begun else seconds
    finally:
        client.close()
        enemy.close()
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        os.sched_setaffinity(0, cores)


def engine(name: str, policy: Path, rate_hz: float, seconds: float) -> dict[str, Any]:
    """Wakes at a pace, runs the policy once, and times it from when it was due."""
    loaded = Artefact.load(policy)
    told = realtime.request(FIFO)  # first, so that an engine's threads inherit it
    makers = {"numpy": PolicyRuntime, "nothing": PolicyRuntime, "onnxruntime": onnx_engine, "jax": jax_engine}
    act = makers[name](loaded)
    observations = np.random.default_rng(0).standard_normal((64, 15)).astype(np.float32)
    observations *= np.asarray(loaded.observation_scales, np.float32)
    worst = max(float(np.max(np.abs(act(x) - PolicyRuntime(loaded)(x)))) for x in observations)
    if worst > 1e-4:
        raise RuntimeError(f"{name} differs from the runtime by {worst:.1e}")
    if name == "nothing":
        act = np.asarray
    histogram = Histogram(1 / rate_hz)
    due = time.monotonic_ns()
    period = round(1e9 / rate_hz)
    for k in range(round(seconds * rate_hz)):
        due += period
        while (left := due - time.monotonic_ns()) > 0:
            select.select([], [], [], left * 1e-9)
        act(observations[k % 64])
        histogram.add((time.monotonic_ns() - due) * 1e-9)
    quantiles = {f"p{q:g}_us".replace(".", ""): q / 100 for q in (50, 99, 99.9)}
    return {
        **{key: round(1e6 * histogram.quantile(q), 1) for key, q in quantiles.items()},
        "max_us": round(1e6 * histogram.largest_s, 1),
        "count": histogram.count,
        "missed": histogram.missed,
        "fifo": told[0],
    }


def onnx_engine(policy: Artefact) -> Callable[[np.ndarray], np.ndarray]:
    """Onnxruntime, one thread, no spinning."""
    import onnxruntime

    from mjx_cutting.deploy.onnx_model import write_onnx

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "policy.onnx"
        write_onnx(policy, path)
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    given = session.get_inputs()[0]

    def act(observation: np.ndarray) -> np.ndarray:
        return session.run(None, {given.name: observation[None]})[0][0]

    return act


def jax_engine(policy: Artefact) -> Callable[[np.ndarray], np.ndarray]:
    """The same function under jax.jit, on the CPU."""
    os.environ["JAX_PLATFORMS"] = "cpu"
    import jax
    import jax.numpy as jnp

    scale = jnp.asarray(policy.observation_scales, jnp.float32)

    @jax.jit
    def forward(observation: Any) -> Any:
        x = jnp.clip((observation / scale - policy.mean) / policy.std, -policy.clip, policy.clip)
        for weights, bias in policy.layers[:-1]:
            x = jax.nn.silu(x @ weights + bias)
        return jnp.tanh(x @ policy.layers[-1][0] + policy.layers[-1][1])

    return lambda observation: np.asarray(forward(observation))


def attack(count: int) -> dict[str, Any]:
    """Hostile packets straight into the packet handling of a server in a running cut.

    Half of them from the peer's own address to a server with a key; half, whose CRC is all there is to forge,
    to one without a key from another address.
    """
    grown, spent, acted = 0.0, 0.0, 0
    for key, address in ((b"0123456789abcdef", ("127.0.0.1", 1)), (None, ("127.0.0.1", 2))):
        server = Server(PolicyRuntime(artefact(0.02)), Settings(key=key), lambda line: None)
        numbers: dict[str, Any] = {"session": 9, "time_ns": 1, "key": key}
        good = [protocol.encode(Type.HELLO, sequence=1, challenge=0, **numbers)]
        welcome = protocol.decode(server.handle(good[0], ("127.0.0.1", 1), 0) or b"", key)
        assert isinstance(welcome, protocol.Packet)
        still = (0.0, 0.0, 0.0)
        state = State(Robot.READY, 0, still, still, still, (1.0, 2.0, 3.0), 0.0, 0.0, 0.0, 0.0, 0.0)
        for at, kind in enumerate((Type.STATE, Type.ARM, Type.START), 2):
            body = state if kind is Type.STATE else None
            good.append(protocol.encode(kind, body, sequence=at, challenge=welcome.challenge, **numbers))
            server.handle(good[-1], ("127.0.0.1", 1), 0)
        given = hostile.packets(good)
        for packet in itertools.islice(given, 5000):
            server.handle(packet, address, 1)
        accepted, before = server.counts["accepted"], resident_mb()
        for packet in itertools.islice(given, count // 2):
            start = time.perf_counter()
            answer = server.handle(packet, address, 1)
            spent += time.perf_counter() - start
            acted += answer is not None or server.mode is not Mode.RUNNING
        acted += server.counts["accepted"] - accepted
        grown += resident_mb() - before
    return {
        "hostile_packets": 2 * (count // 2),
        "acted_on": acted,
        "hostile_memory_mb": round(grown, 3),
        "hostile_us": round(1e6 * spent / count, 2),
    }


def stolen_s(core: int) -> float:
    """Time, s, for which the host of a virtual machine has kept this core for others."""
    for line in Path("/proc/stat").read_text().splitlines():
        if line.startswith(f"cpu{core} "):
            return int(line.split()[8]) / os.sysconf("SC_CLK_TCK")
    return 0.0


def resident_mb() -> float:
    """Resident memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE") / 2**20


def spin(core: int) -> None:
    """Keeps a core busy until terminated or left by its parent."""
    os.sched_setaffinity(0, [core])
    parent = os.getppid()
    while os.getppid() == parent:
        sum(range(100_000))


def run(line: list[str], core: int | None = None) -> str:
    """The output of a command, on one core where given."""
    pin = None if core is None else lambda: os.sched_setaffinity(0, [core])
    done = subprocess.run(line, capture_output=True, text=True, preexec_fn=pin)
    if done.returncode:
        raise RuntimeError(f"{' '.join(line)} failed: {done.stderr[-2000:]}")
    return done.stdout


def row(name: str, found: dict[str, Any]) -> str:
    """One line of the table."""
    figures = ", ".join(f"{key[:-3]} {found[key]:.0f}" for key in ("p50_us", "p99_us", "p999_us", "max_us"))
    rest = f"missed {found['missed']}; {found['fifo']}; stolen {found['stolen_s']} s"
    return f"{name}: {figures} us of {found['count']}; {rest}"


if __name__ == "__main__":
    main()
