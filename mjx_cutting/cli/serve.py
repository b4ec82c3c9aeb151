"""`mjx-cutting serve`: an exported policy, served over UDP to a robot's controller; or its statistics."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from mjx_cutting.deploy.recorder import Recorder
    from mjx_cutting.deploy.runtime import PolicyRuntime

SHORTEST_KEY = 16


@dataclass(frozen=True)
class Serve:
    """Serves an exported policy over UDP (docs/serving.md), records what it does, and stops safely."""

    policy: Annotated[Path | None, tyro.conf.Positional] = None
    """Exported policy, .npz (mjx-cutting export writes one)."""

    port: int = 50500
    """UDP port; the statistics are on the TCP port of the same number. 0 takes a free one and says which."""

    bind: str = "127.0.0.1"
    """Address to listen on; loopback unless told otherwise."""

    key_file: Path | None = None
    """File with the shared key, at least 16 bytes: packets must then be signed (HMAC-SHA256)."""

    record: Path | None = None
    """Folder to record trials to, in the dataset format. Default: nothing is recorded."""

    session: Path | None = None
    """JSON with tool, sensor and conditions of what is recorded. Default: from the policy's training."""

    material: str | None = None
    """Name of the sheet's material, written to the trials where no --session is given."""

    fifo: int = 50
    """SCHED_FIFO priority to ask for, 1 to 99; 0: ordinary scheduling. Said where it is not permitted."""

    watch: bool = False
    """Take the policy's file again when it changes while IDLE (SIGHUP does so at any time)."""

    force_limit_n: float = 250.0
    """Force at which the cut is stopped, N, three samples in a row."""

    deviation_limit_m: float = 0.15
    """Path error at which the cut is stopped, m."""

    hold_s: float = 0.1
    """Silence of the controller, s, after which the cut is stopped; until then the set-points are held."""

    nominal_feed_m_s: float | None = None
    """Feed at adjustment 0, m/s. Default: that of the policy's training, else 0.0125."""

    seconds: float | None = None
    """Stop after so many seconds. Default: serve until a signal."""

    stats: str | None = None
    """HOST:PORT of a running server: print its statistics (Prometheus text), and serve nothing."""

    def run(self) -> int:
        """Returns 0; 1 where recording failed."""
        if self.stats is not None:
            return _stats(self.stats)
        if self.policy is None:
            raise ValueError(
                "got no policy; expected an exported .npz, or --stats HOST:PORT: mjx-cutting serve policy.npz"
            )
        return self._serve(self.policy)

    def _serve(self, policy: Path) -> int:
        import time

        from mjx_cutting.deploy import realtime, sessions
        from mjx_cutting.deploy.safety import Limits
        from mjx_cutting.deploy.server import Server, Settings
        from mjx_cutting.deploy.service import Log, Service, bind, load, say
        from mjx_cutting.deploy.stats import StatsPort

        runtime = load(policy)
        key = _key(self.key_file)
        feed_m_s = self.nominal_feed_m_s or sessions.nominal_feed_m_s(runtime.artefact, 0.0125)
        limits = Limits(force_n=self.force_limit_n, deviation_m=self.deviation_limit_m, hold_s=self.hold_s)
        udp = bind(self.bind, self.port)
        port = udp.getsockname()[1]
        stats = StatsPort(self.bind, port)
        recorder = self._recorder(runtime)
        log = Log()
        server = Server(runtime, Settings(limits, key, feed_m_s), log, recorder)
        say(f"policy {runtime.artefact.sha256[:16]}, every {runtime.artefact.policy_period_s * 1e3:g} ms")
        for line in realtime.request(self.fifo or None):
            say(line)
        if self.bind not in ("127.0.0.1", "::1", "localhost") and key is None:
            say(f"warning: bound to {self.bind} without a key; whoever reaches this port can move the robot")
        service = Service(server, udp, log, policy=policy, watch=self.watch, stats=stats, recorder=recorder)
        service.install_signals()
        say(f"serving on {self.bind}:{port}")
        end_s = None if self.seconds is None else time.monotonic() + self.seconds
        try:
            service.run(None if end_s is None else lambda: time.monotonic() > end_s)
        finally:
            stats.close()
            udp.close()
            complete = recorder is None or recorder.close()
        latency = server.latency
        say(f"{server.commands} COMMANDs, {server.trials} trials; {latency}")
        if not complete and recorder is not None:
            say(f"recording is incomplete: {recorder.lost} samples lost")
        return 0 if complete else 1

    def _recorder(self, runtime: PolicyRuntime) -> Recorder | None:
        if self.record is None:
            return None
        from mjx_cutting.deploy import sessions
        from mjx_cutting.deploy.recorder import Recorder
        from mjx_cutting.trials.parts import check_session

        given = self.session
        session = sessions.read(given) if given else sessions.of(runtime.artefact, self.material)
        check_session(session)
        return Recorder(self.record, session)


def _key(path: Path | None) -> bytes | None:
    if path is None:
        return None
    key = path.read_bytes().strip()
    if len(key) < SHORTEST_KEY:
        raise ValueError(
            f"got a key of {len(key)} bytes in {path}; expected at least {SHORTEST_KEY}: "
            "head -c 32 /dev/urandom | base64 > key"
        )
    return key


def _stats(place: str) -> int:
    from mjx_cutting.deploy.stats import ask

    host, _, port = place.rpartition(":")
    if not host or not port.isdigit():
        raise ValueError(f"got {place!r}; expected HOST:PORT, such as 127.0.0.1:50500")
    print(ask(host.strip("[]"), int(port)), end="")
    return 0
