"""Files of public data, whole and checked: from a folder the user names, from the cache, or downloaded.

The idea: a file counts only if its SHA-256 is the pinned one. A download goes to a temporary name in the
cache and is renamed when its hash fits, so a cut-off transfer or a wrong file leaves nothing behind; it is
retried, then given up with a sentence that says what failed and how to get the data otherwise.

The assumption that breaks it: a server that answers HTTP GET. A web proxy that rewrites files fails the hash,
and is told so.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

TIMEOUT_S = 20.0
RETRIES = 2
VARIABLE = "MJX_CUTTING_DATA"


class DownloadError(OSError):
    """Public data could not be had; the message says what failed and how to mend it."""


@dataclass(frozen=True)
class RemoteFile:
    """One file of public data: its name here, its path below the source's base address, its SHA-256 and size
    [bytes].
    """

    name: str
    path: str
    sha256: str
    size_bytes: int


def sha256_of(path: Path) -> str:
    """The SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def check_folder(folder: Path, files: tuple[RemoteFile, ...]) -> None:
    """Raises ValueError where a file of a local copy is missing or is not the pinned one."""
    for file in files:
        path = folder / file.name
        if not path.is_file():
            raise ValueError(
                f"{path}: got no such file, expected it in the folder that {VARIABLE} names; add it, or "
                f"unset {VARIABLE} to download."
            )
        got = sha256_of(path)
        if got != file.sha256:
            raise ValueError(
                f"{path}: got SHA-256 {got[:16]}..., expected {file.sha256[:16]}...; this is not the pinned "
                "file: replace it, or unset "
                f"{VARIABLE} to download."
            )


def is_cached(folder: Path, files: tuple[RemoteFile, ...]) -> bool:
    """True where every file lies whole in the folder."""
    return all(
        (folder / file.name).is_file() and sha256_of(folder / file.name) == file.sha256 for file in files
    )


def download(
    files: tuple[RemoteFile, ...],
    base_url: str,
    folder: Path,
    *,
    retries: int = RETRIES,
    timeout_s: float = TIMEOUT_S,
    progress: bool = True,
) -> Path:
    """The folder, with every file in it whole; those already there are not fetched again.

    Arguments: files; base_url they lie below; folder in the user's cache; retries after a failure; timeout_s
    of each connection and read [s]; progress, whether to show a bar on a terminal.

    Raises DownloadError where a file cannot be had. Files fetched before the failure stay, whole, for the
    next attempt.
    """
    import pooch
    import requests.exceptions

    fetcher = pooch.create(
        path=folder,
        base_url=base_url if base_url.endswith("/") else base_url + "/",
        registry={file.name: f"sha256:{file.sha256}" for file in files},
        urls={file.name: _join(base_url, file.path) for file in files},
        retry_if_failed=retries,
    )
    with _quiet_logger(pooch), _bars(progress) as bar_for:
        for file in files:
            if (folder / file.name).is_file() and sha256_of(folder / file.name) == file.sha256:
                continue
            downloader = pooch.HTTPDownloader(timeout=timeout_s, progressbar=bar_for(file))
            try:
                fetcher.fetch(file.name, downloader=downloader)
            except (requests.exceptions.RequestException, ValueError, OSError) as error:
                raise DownloadError(_explain(file, _join(base_url, file.path), folder, error)) from error
    return folder


def _join(base_url: str, path: str) -> str:
    from urllib.parse import quote

    return base_url.rstrip("/") + "/" + quote(path)


def _explain(file: RemoteFile, url: str, folder: Path, error: Exception) -> str:
    import requests.exceptions as kinds

    if isinstance(error, kinds.HTTPError) and error.response is not None:
        got, mend = f"the answer {error.response.status_code} {error.response.reason}", "try again later"
    elif isinstance(error, kinds.ChunkedEncodingError | kinds.ContentDecodingError):
        got, mend = "a transfer that was cut off", "check the connection and try again"
    elif isinstance(error, kinds.Timeout) or "timed out" in str(error):
        got, mend = "no answer in time", "check the connection and try again"
    elif isinstance(error, kinds.ConnectionError):
        got, mend = "no connection", "check the network and try again"
    elif isinstance(error, kinds.RequestException):
        got, mend = f"{type(error).__name__}: {error}", "check the address and the network"
    elif isinstance(error, ValueError):
        got, mend = (
            "a file with another SHA-256",
            "something on the way changes files, or the source did; try another network",
        )
    else:
        got, mend = f"a cache that cannot be written ({error})", "free space or give another cache folder"
    return (
        f"{file.name}: got {got} from {url}, expected {file.size_bytes} bytes with SHA-256 "
        f"{file.sha256[:16]}...; {mend}, or put the "
        f"file into a folder laid out as <folder>/{folder.name}/{file.name} and set {VARIABLE} to <folder>. "
        "Nothing half "
        "written was kept."
    )


@contextmanager
def _quiet_logger(pooch: Any) -> Iterator[None]:
    logger = pooch.get_logger()
    level = logger.level
    logger.setLevel("WARNING")
    try:
        yield
    finally:
        logger.setLevel(level)


@contextmanager
def _bars(show: bool) -> Iterator[Callable[[RemoteFile], Any]]:
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TransferSpeedColumn

    console = Console(stderr=True)
    if not (show and console.is_terminal):
        yield lambda file: False
        return
    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TransferSpeedColumn())
    with Progress(*columns, console=console) as progress:
        yield lambda file: _Bar(progress, file)


class _Bar:
    """What pooch expects of a progress bar (tqdm's manner), drawn by rich."""

    def __init__(self, progress: Any, file: RemoteFile) -> None:
        self.progress = progress
        self.task = progress.add_task(file.name, total=file.size_bytes)
        self.total = file.size_bytes

    def update(self, amount: int) -> None:
        self.progress.update(self.task, advance=amount)

    def reset(self) -> None:
        self.progress.reset(self.task)

    def close(self) -> None:
        self.progress.update(self.task, completed=self.total, total=self.total)
