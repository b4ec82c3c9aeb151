"""Records every session as trials, in a process of its own, so that no disk ever delays a COMMAND.

The server packs samples into a pipe that it never waits for; this process writes them as one-second parts and
merges each trial when it ends (see trials/parts.py). Killed at any moment, the server leaves a complete
dataset, because this process sees the pipe's end; killed itself, it leaves all but the last second, which the
next reader merges. When the disk is full, recording stops, the reason is said, and serving goes on.
"""

from __future__ import annotations

import fcntl
import json
import os
import select
import struct
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mjx_cutting.deploy.protocol import State

# isort: split
import numpy as np

_SAMPLE = struct.Struct("<qq16d")
"""`trials.parts.SAMPLE`. A time of -1 ends the trial."""

_END = _SAMPLE.pack(-1, 0, *(0.0,) * 16)
_PIPE_BYTES = 2**20
_KEPT_BYTES = 2**22
"""Half a minute of samples kept while the pipe is full; what comes then is lost and counted."""


class Recorder:
    """The server's end of the pipe.

    Arguments:
        folder: dataset folder; session: as `trials.parts.check_session` takes it.

    Raises:
        OSError: the recording process cannot be started.
    """

    def __init__(self, folder: Path, session: Mapping[str, Any]):
        line = [sys.executable, "-m", __name__, str(folder), json.dumps(session)]
        self._child = subprocess.Popen(line, stdin=subprocess.PIPE, start_new_session=True)
        assert self._child.stdin is not None
        self._pipe = self._child.stdin.fileno()
        os.set_blocking(self._pipe, False)
        if hasattr(fcntl, "F_SETPIPE_SZ"):
            fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        self._kept = bytearray()
        self._trial = 0
        self._news: str | None = None
        self.taken = 0
        self.lost = 0
        self.failed = False

    def __call__(self, time_ns: int, state: State, set_point: np.ndarray, trial: int) -> None:
        """Takes one sample; never waits."""
        if self.failed or len(self._kept) > _KEPT_BYTES:
            self.lost += 1
            return
        if self._trial and self._trial != trial:
            self._kept += _END
        self._trial = trial
        self._kept += _SAMPLE.pack(
            time_ns, state.flags, *state.force_n, *state.position_m, state.spindle_angle_rad,
            state.spindle_speed_rev_s, state.speed_along_m_s, state.path_m, state.cut_length_m, *set_point,
        )  # fmt: skip
        self.taken += 1

    def flush(self, running: bool) -> None:
        """Hands on what the pipe takes at once; the trial ends where no longer `running`."""
        if self._trial and not running:
            self._kept += _END
            self._trial = 0
        if not self._kept:
            return
        try:
            del self._kept[: os.write(self._pipe, self._kept)]
        except BlockingIOError:
            pass
        except OSError:
            self.failed = True
            self.lost += len(self._kept) // _SAMPLE.size
            self._kept.clear()
            self._news = "recording stopped (its process ended, and said why); serving goes on"

    def news(self) -> str | None:
        """One line, once, where recording stopped."""
        line, self._news = self._news, None
        return line

    def close(self, timeout_s: float = 30.0) -> bool:
        """Ends the session and waits for it; whether everything was recorded."""
        end_s = time.monotonic() + timeout_s
        self.flush(running=False)
        while self._kept and time.monotonic() < end_s:
            select.select([], [self._pipe], [], 0.1)
            self.flush(running=False)
        self.lost += len(self._kept) // _SAMPLE.size
        assert self._child.stdin is not None
        self._child.stdin.close()
        try:
            return self._child.wait(max(0.0, end_s - time.monotonic())) == 0 and not self.lost
        except subprocess.TimeoutExpired:
            return False  # it goes on by itself


def record(folder: Path, session: Mapping[str, Any], pipe: int) -> None:
    """Writes what comes through the pipe until it ends.

    Raises:
        ValueError: the folder or the session does not fit.
        OSError: it cannot be written; the parts written so far stay.
    """
    from mjx_cutting.trials.parts import SAMPLE, Parts

    parts = Parts(folder, session)
    second = round(float(session["sensor"]["sample_rate_hz"])) * SAMPLE.itemsize
    kept, begun = b"", False
    while True:
        chunk = os.read(pipe, second)
        kept += chunk
        whole = len(kept) // SAMPLE.itemsize * SAMPLE.itemsize
        ready = np.frombuffer(kept[:whole], SAMPLE)
        ends = np.flatnonzero(ready["time_ns"] < 0)
        if chunk and not len(ends) and whole < second:
            continue
        kept = kept[whole:]
        for run in np.split(ready, ends):
            if len(run) and run["time_ns"][0] < 0:
                _say(parts.end())
                run, begun = run[1:], False
            if len(run):
                if not begun:
                    parts.begin()
                    begun = True
                parts.add(run)
        if not chunk:
            _say(parts.close())
            return


def _say(lines: list[str]) -> None:
    for line in lines:
        print(f"recorder: {line}", file=sys.stderr, flush=True)


def main(arguments: list[str]) -> int:
    """The recording process: folder and session as JSON; samples on standard input."""
    from mjx_cutting._files import explain

    try:
        record(Path(arguments[0]), json.loads(arguments[1]), sys.stdin.fileno())
    except (OSError, ValueError) as error:
        told = explain(error) if isinstance(error, OSError) else str(error)
        _say([f"{told}; recording has stopped, what was written stays"])
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
