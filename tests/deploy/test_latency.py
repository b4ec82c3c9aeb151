"""The histogram, the statistics' text and its port, and what the system grants for real time."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.latency import Histogram
from mjx_cutting.deploy.runtime import PolicyRuntime
from mjx_cutting.deploy.server import Server, Settings
from mjx_cutting.deploy.stats import StatsPort, ask, prometheus


def test_quantiles_are_within_one_percent() -> None:
    draw = np.random.default_rng(0)
    values = np.exp(draw.normal(np.log(3e-4), 1.0, 20_000))
    histogram = Histogram(deadline_s=2e-3)
    for value in values:
        histogram.add(float(value))
    for q in (0.5, 0.99, 0.999):
        assert histogram.quantile(q) == pytest.approx(
            np.quantile(values, q, method="inverted_cdf"), rel=0.011
        )
    assert histogram.quantile(1.0) == histogram.largest_s == values.max()
    assert histogram.missed == (values > 2e-3).sum()
    assert histogram.below(1e-3) == pytest.approx((values < 1e-3).sum(), rel=0.02)
    assert histogram.below(100.0) == histogram.count == 20_000


def test_values_off_the_scale_are_counted() -> None:
    histogram = Histogram()
    assert histogram.quantile(0.5) == 0.0
    for value in (-1e-3, 0.0, 1e-9, 50.0):
        histogram.add(value)
    assert histogram.count == 4 and histogram.largest_s == 50.0
    assert histogram.quantile(0.5) < 2e-6 and 9 < histogram.quantile(1.0) <= 50


@pytest.fixture
def server(served: Artefact) -> Server:
    return Server(PolicyRuntime(served), Settings(), lambda line: None)


def test_the_text_is_what_prometheus_reads(server: Server) -> None:
    for value in (1e-4, 3e-4, 4e-2):
        server.latency.add(value)
    server.handle(b"nonsense", ("127.0.0.1", 1), 0)
    text = prometheus(server, recorded=5, not_recorded=2)
    family, values = None, {}
    for line in text.splitlines():
        if found := re.fullmatch(r"# HELP (\w+) \S.*", line):
            family = found[1]
        elif found := re.fullmatch(r"# TYPE (\w+) (counter|gauge|histogram)", line):
            assert found[1] == family
        else:
            found = re.fullmatch(r'(\w+)(\{\w+="[^"]*"(?:,\w+="[^"]*")*\})? (\S+)', line)
            assert found and family and found[1].startswith(family), line
            values[found[1] + (found[2] or "")] = float(found[3])
    buckets = [
        value for name, value in values.items() if name.startswith("mjx_cutting_latency_seconds_bucket")
    ]
    assert buckets == sorted(buckets) and buckets[-1] == 3
    assert values['mjx_cutting_packets_total{result="size"}'] == 1
    assert values["mjx_cutting_deadlines_missed_total"] == 1
    assert values["mjx_cutting_samples_not_recorded_total"] == 2


def test_the_port_answers_and_never_waits(server: Server) -> None:
    port = StatsPort("127.0.0.1", 0)
    end = threading.Event()
    longest = 0.0

    def look() -> None:
        nonlocal longest
        while not end.is_set():
            start = time.perf_counter()
            port.poll(lambda: prometheus(server))
            longest = max(longest, time.perf_counter() - start)
            time.sleep(0.002)

    thread = threading.Thread(target=look)
    thread.start()
    try:
        with socket.create_connection(("127.0.0.1", port.port)):  # says nothing, and is hung up on
            assert "mjx_cutting_info" in ask("127.0.0.1", port.port, timeout_s=5.0)
        assert "mjx_cutting_info" in ask("127.0.0.1", port.port)
    finally:
        end.set()
        thread.join()
        port.close()
    assert longest < 0.5
    with pytest.raises(OSError):
        ask("127.0.0.1", port.port)


def test_what_is_not_permitted_is_said() -> None:
    code = (
        "import os, resource\n"
        "from mjx_cutting.deploy import realtime\n"
        "resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))\n"
        "resource.setrlimit(resource.RLIMIT_MEMLOCK, (0, 0))\n"
        "if os.getuid() == 0: os.setuid(65534)\n"
        "print('\\n'.join(realtime.request(50)))\n"
        "print(len(realtime.request(None)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    fifo, idle, memory, count = done.stdout.splitlines()
    assert "SCHED_FIFO 50: not permitted" in fifo and "CAP_SYS_NICE" in fifo
    assert "idle states: not held off (/dev/cpu_dma_latency" in idle
    assert "memory: not locked" in memory and count == "1"
