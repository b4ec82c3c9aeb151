"""A server's statistics as Prometheus text, asked for over TCP: `curl HOST:PORT/metrics`.

No thread and no HTTP library: the serving loop looks at the listening socket once a period, after its COMMAND
is out, takes at most one request, and never waits for it.
"""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable

import mjx_cutting
from mjx_cutting.deploy.protocol import Mode
from mjx_cutting.deploy.server import Server

QUANTILES = (0.5, 0.99, 0.999)
BUCKETS_S = (50e-6, 100e-6, 200e-6, 500e-6, 1e-3, 2e-3, 5e-3, 10e-3, 20e-3)
_PATIENCE = 50
"""Looks at a connection that has asked for nothing yet, before it is closed."""


def prometheus(server: Server, recorded: int = 0, not_recorded: int = 0) -> str:
    """Returns the text: packets by result, state, COMMANDs, latency, deadlines missed, trials recorded."""
    latency = server.latency
    lines = [
        "# HELP mjx_cutting_info The policy served.",
        "# TYPE mjx_cutting_info gauge",
        f'mjx_cutting_info{{version="{mjx_cutting.__version__}",'
        f'policy_sha256="{server.runtime.artefact.sha256}"}} 1',
        "# HELP mjx_cutting_packets_total Packets received, by what became of them.",
        "# TYPE mjx_cutting_packets_total counter",
        *(f'mjx_cutting_packets_total{{result="{name}"}} {n}' for name, n in server.counts.items()),
        "# HELP mjx_cutting_mode 1 for the present state of the safety state machine.",
        "# TYPE mjx_cutting_mode gauge",
        *(f'mjx_cutting_mode{{mode="{mode.name.lower()}"}} {int(mode is server.mode)}' for mode in Mode),
        "# HELP mjx_cutting_latency_seconds From the time a COMMAND was due until it was sent.",
        "# TYPE mjx_cutting_latency_seconds histogram",
        *(f'mjx_cutting_latency_seconds_bucket{{le="{le:g}"}} {latency.below(le)}' for le in BUCKETS_S),
        f'mjx_cutting_latency_seconds_bucket{{le="+Inf"}} {latency.count}',
        f"mjx_cutting_latency_seconds_sum {latency.sum_s:.9g}",
        f"mjx_cutting_latency_seconds_count {latency.count}",
        "# HELP mjx_cutting_latency_quantile_seconds Its quantiles since the start; 1 is the largest.",
        "# TYPE mjx_cutting_latency_quantile_seconds gauge",
        *(
            f'mjx_cutting_latency_quantile_seconds{{quantile="{q:g}"}} {latency.quantile(q):.6g}'
            for q in QUANTILES
        ),
        f'mjx_cutting_latency_quantile_seconds{{quantile="1"}} {latency.largest_s:.6g}',
    ]
    for name, help_, value in (
        ("commands_total", "COMMANDs sent.", server.commands),
        ("deadlines_missed_total", "COMMANDs sent a whole period late.", latency.missed),
        ("held_total", "Periods in which the set-points were held for want of a fresh STATE.", server.held),
        ("trials_total", "Times RUNNING was entered.", server.trials),
        ("policy_swaps_total", "Policies taken while serving.", server.swaps),
        ("policy_swaps_refused_total", "Policies refused while serving.", server.swaps_refused),
        ("samples_recorded_total", "Samples handed to the recorder.", recorded),
        ("samples_not_recorded_total", "Samples lost to recording; serving went on.", not_recorded),
    ):
        lines += [
            f"# HELP mjx_cutting_{name} {help_}",
            f"# TYPE mjx_cutting_{name} counter",
            f"mjx_cutting_{name} {value}",
        ]
    return "\n".join(lines) + "\n"


class StatsPort:
    """A listening TCP socket, looked at by `poll`.

    Arguments:
        host, port: where to listen; port 0 takes a free one.

    Raises:
        OSError: the port is taken or not permitted.
    """

    def __init__(self, host: str, port: int):
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._listener = socket.create_server((host, port), family=family, backlog=8)
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self._asking: socket.socket | None = None
        self._looks = 0

    def poll(self, text: Callable[[], str]) -> None:
        """Takes or answers at most one request; returns at once."""
        with contextlib.suppress(BlockingIOError, ConnectionError, OSError):
            if self._asking is None:
                self._asking, _ = self._listener.accept()
                self._asking.setblocking(False)
                self._looks = 0
                return
            self._looks += 1
            if self._looks > _PATIENCE:
                self._hang_up()
                return
            if self._asking.recv(4096):
                body = text().encode()
                head = (
                    "HTTP/1.0 200 OK\r\nContent-Type: text/plain; version=0.0.4; charset=utf-8\r\n"
                    f"Content-Length: {len(body)}\r\nConnection: close\r\n\r\n"
                )
                self._asking.send(head.encode() + body)  # some 6 kB: fits the socket's buffer
            self._hang_up()

    def close(self) -> None:
        """Stops listening."""
        self._hang_up()
        self._listener.close()

    def _hang_up(self) -> None:
        if self._asking is not None:
            self._asking.close()
            self._asking = None


def ask(host: str, port: int, timeout_s: float = 2.0) -> str:
    """Returns the statistics of a running server.

    Raises:
        OSError: nobody answers there.
        ValueError: what answers is no policy server.
    """
    with socket.create_connection((host, port), timeout=timeout_s) as connection:
        connection.sendall(b"GET /metrics HTTP/1.0\r\n\r\n")
        answer = b""
        while chunk := connection.recv(65536):
            answer += chunk
    head, _, body = answer.partition(b"\r\n\r\n")
    if b" 200 " not in head or b"mjx_cutting_info" not in body:
        raise ValueError(f"got an answer from {host}:{port} that is no policy server's; check the port")
    return body.decode()
