"""The run folder: settings, versions and metrics, so that every figure names the command behind it.

    OUT/config.json     the resolved settings, with the verb and the seed
    OUT/versions.json   package versions, Python, machine, git revision, command line, start in UTC
    OUT/metrics.jsonl   one JSON object a line, appended as the run goes

A rerun into the same folder replaces config.json and versions.json and appends to metrics.jsonl.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import platform
import subprocess
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from mjx_cutting import _platform
from mjx_cutting._files import write_atomic


def open_run(out: str | os.PathLike[str] | None, verb: str, config: Any, seed: int | None) -> Path:
    """Returns the run folder, made where missing, with config.json and versions.json in it.

    Args:
        out: the folder; None: `runs/<UTC time>-<verb>` under the working directory.
        verb: what is run (`train`, `trace`, ...), lower case.
        config: the resolved settings: a dataclass or a mapping of JSON-like values.
        seed: the seed that everything random comes from; None where nothing is.

    Raises:
        OSError: the folder cannot be written.
        TypeError: a setting is of a kind that JSON cannot hold.
    """
    folder = Path(out) if out is not None else default_folder(verb)
    settings = json.dumps({"verb": verb, "seed": seed, "config": plain(config)}, indent=2)
    folder.mkdir(parents=True, exist_ok=True)
    write_atomic(folder / "config.json", settings + "\n")
    write_atomic(folder / "versions.json", json.dumps(provenance(), indent=2) + "\n")
    return folder


def default_folder(verb: str) -> Path:
    """Returns a folder name that is not taken: `runs/<UTC time>-<verb>` under the working directory."""
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    folder, count = Path("runs") / f"{stamp}-{verb}", 1
    while folder.exists():
        count += 1
        folder = Path("runs") / f"{stamp}-{verb}-{count}"
    return folder


def append_metrics(folder: str | os.PathLike[str], metrics: Mapping[str, Any]) -> None:
    """Appends one line to metrics.jsonl; a number that is not finite is written as null."""
    line = json.dumps(plain(metrics)) + "\n"
    descriptor = os.open(Path(folder) / "metrics.jsonl", os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
    try:
        os.write(descriptor, line.encode())
    finally:
        os.close(descriptor)


def provenance() -> dict[str, Any]:
    """Returns versions, machine, git revision, command line and the time in UTC."""
    return {
        "versions": _platform.versions(),
        "machine": {
            "system": platform.system(),
            "release": platform.release(),
            "architecture": platform.machine(),
            "cpus": os.cpu_count(),
        },
        "git": git_revision(),
        "command": [Path(sys.argv[0]).name, *sys.argv[1:]],
        "time_utc": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def git_revision() -> dict[str, Any] | None:
    """Returns the commit and whether tracked files differ from it; None outside a checkout."""
    root = Path(__file__).resolve().parent.parent
    if not (root / ".git").exists():
        return None
    try:
        commit = _git(root, "rev-parse", "HEAD")
        return {
            "commit": commit,
            "modified": bool(_git(root, "status", "--porcelain", "--untracked-files=no")),
        }
    except (OSError, subprocess.SubprocessError):
        return None


def plain(value: Any) -> Any:
    """Returns `value` as JSON types: dataclasses and mappings as dicts, arrays as lists, paths as text."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in (sorted(value) if isinstance(value, set | frozenset) else value)]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if hasattr(value, "tolist"):  # NumPy and JAX arrays and scalars
        return plain(value.tolist())
    raise TypeError(
        f"got a {type(value).__name__} ({value!r}) in a run's settings or metrics; expected numbers, text, "
        "lists, dicts or dataclasses of them: turn it into one of those first"
    )


def _git(root: Path, *arguments: str) -> str:
    done = subprocess.run(
        ["git", "-C", str(root), *arguments], capture_output=True, text=True, timeout=10, check=True
    )
    return done.stdout.strip()
