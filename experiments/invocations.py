"""The time that an experiment took, over all the commands that worked on its folder.

    OUT/invocations.json   [{"began_utc": .., "wall_s": ..}, ...]

An experiment that was stopped goes on by the same command, so its time is the sum over these commands and not
that of the last. The file is written anew every few seconds, so a command that was killed is counted too.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any

from mjx_cutting import _files

FILE = "invocations.json"
EVERY_S = 10.0


class Invocations:
    """A context that counts the time spent in it.

    Arguments:
        out: folder of the experiment; it exists.
        unrecorded_s: called where the folder has no record: seconds that were spent on it before, 0 for none.
    """

    def __init__(self, out: Path, unrecorded_s: Callable[[], float] = lambda: 0.0):
        self.path = Path(out) / FILE
        if self.path.is_file():
            self.past: list[dict[str, Any]] = json.loads(self.path.read_text())
        else:
            spent = unrecorded_s()
            told = "not recorded; the time of the trainings found in the folder"
            self.past = [{"wall_s": round(spent, 1), "note": told}] if spent > 0 else []
        self._now = {"began_utc": datetime.now(UTC).isoformat(timespec="seconds")}
        self._began = time.monotonic()
        self._over = threading.Event()
        self._beat = threading.Thread(target=self._record, daemon=True)

    def __enter__(self) -> Invocations:
        self._began = time.monotonic()
        self._write()
        self._beat.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._beat.join()
        self._write()

    @property
    def all(self) -> list[dict[str, Any]]:
        """Every command so far, this one last."""
        return [*self.past, {**self._now, "wall_s": round(time.monotonic() - self._began, 1)}]

    @property
    def wall_s(self) -> float:
        """Seconds of all commands so far."""
        return round(sum(each["wall_s"] for each in self.all), 1)

    def _record(self) -> None:
        while not self._over.wait(EVERY_S):
            self._write()

    def _write(self) -> None:
        _files.write_atomic(self.path, json.dumps(self.all, indent=1) + "\n")
