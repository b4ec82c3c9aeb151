"""The run folder of a verb whose results are written at its end: there whole, or not there at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mjx_cutting import runs
from mjx_cutting._files import staged_folder


@contextmanager
def run_folder(out: Path | None, verb: str, options: Any, seed: int | None) -> Iterator[tuple[Path, Path]]:
    """Yields (the folder to write into now, the folder that it becomes when the block succeeds).

    config.json and versions.json are in it already, so an output folder that cannot be written is found
    before the work, not after it. Where the block fails or is interrupted nothing is left.

    Args:
        out: the folder, new or empty; None: runs/<UTC time>-<verb>.
        verb: what is run.
        options: the verb's dataclass.
        seed: of everything random; None where nothing is.

    Raises:
        ValueError: `out` holds something already.
        OSError: it cannot be written.
    """
    target = runs.default_folder(verb) if out is None else out
    if target.is_dir() and any(target.iterdir()):
        raise ValueError(f"got --out {target}, which holds something already; expected a new or empty folder")
    with staged_folder(target) as staged:
        runs.open_run(staged, verb, options, seed)
        yield staged, target
