"""Files that are either whole or not there: write beside the target, then rename into place.

A rename within one folder is atomic on POSIX file systems, so a reader, a full disk, Ctrl-C or a crash never
sees half a file. What is staged keeps a dot name beside its target; it is removed on any failure, and a stale
one that a killed process left is overwritten by nobody and read by nobody.
"""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_MENDS = {
    errno.ENOSPC: "the disk is full; free some space or choose another --out",
    errno.EDQUOT: "the disk quota is used up; free some space or choose another --out",
    errno.EFBIG: "a file may not grow so large here; raise the limit (ulimit -f) or choose another --out",
    errno.EACCES: "no permission to write there; choose another --out or change the folder's rights",
    errno.EPERM: "no permission to write there; choose another --out or change the folder's rights",
    errno.EROFS: "the file system is read-only; choose another --out",
    errno.ENOTDIR: "part of the path is a file, not a folder; choose another --out",
    errno.ENOENT: "there is no such file or folder; check the path",
    errno.EISDIR: "this is a folder, a file was expected; check the path",
    errno.EEXIST: "something of that name is in the way; choose another --out",
    errno.ENOTEMPTY: "the folder is there already and not empty; choose another --out",
}


def explain(error: OSError) -> str:
    """Returns one line that says what failed, on which path, and how to mend it."""
    if error.errno is None:
        return str(error)
    place = f"{error.filename}: " if error.filename else ""
    reason = _MENDS.get(error.errno)
    return f"{place}{error.strerror}" + (f" ({reason})" if reason else "")


def write_atomic(path: str | os.PathLike[str], content: str | bytes) -> Path:
    """Returns `path`, now holding `content` whole; its folder is made where missing.

    Args:
        path: the file to write; an older one is replaced in one step.
        content: text (written as UTF-8, newlines as given) or bytes.

    Raises:
        OSError: it cannot be written (`explain` makes a message of it); an older file is then untouched.
    """
    path = Path(path)
    data = content.encode() if isinstance(content, str) else content
    with _naming(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, staged = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            os.chmod(staged, 0o666 & ~_umask())
            os.replace(staged, path)
        except BaseException:
            Path(staged).unlink(missing_ok=True)
            raise
    return path


@contextmanager
def staged_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yields a new folder beside `path` that becomes `path` if the block succeeds, else vanishes.

    Args:
        path: the folder to make. An empty folder there is replaced.

    Raises:
        FileExistsError: `path` is a folder with something in it, or a file.
        OSError: it cannot be written.
    """
    path = Path(path)
    if path.exists() and not (path.is_dir() and not any(path.iterdir())):
        raise FileExistsError(errno.EEXIST, "is there already", str(path))
    with _naming(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        staged = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent))
    try:
        yield staged
        with _naming(path):
            os.chmod(staged, 0o777 & ~_umask())
            os.replace(staged, path)
    except BaseException:
        shutil.rmtree(staged, ignore_errors=True)
        raise


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Names the target, not the staged file, in an OSError (a failed write names no file at all)."""
    try:
        yield
    except OSError as error:
        if error.errno is None:
            raise
        raise type(error)(error.errno, os.strerror(error.errno), str(path)) from error


def _umask() -> int:
    value = os.umask(0)
    os.umask(value)
    return value
