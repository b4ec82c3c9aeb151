"""Downloads against a server on the loopback: whole, wrong, cut off, refused, absent; the cache never holds
half a file.
"""

from __future__ import annotations

import contextlib
import hashlib
import http.server
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from mjx_cutting.trials.download import DownloadError, RemoteFile, check_folder, download, is_cached

CONTENT = bytes(range(256)) * 400


class Server(http.server.ThreadingHTTPServer):
    """Serves `pages`; `fail_first` requests are answered by `mode` before it behaves."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.pages: dict[str, bytes] = {}
        self.mode = "whole"
        self.fail_first = 10**9
        self.requests: list[str] = []

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}/data"


class Handler(http.server.BaseHTTPRequestHandler):
    server: Server

    def do_GET(self) -> None:
        server = self.server
        server.requests.append(self.path)
        mode = server.mode if len(server.requests) <= server.fail_first else "whole"
        content = server.pages.get(self.path)
        if content is None:
            self.send_error(404)
            return
        if mode == "error":
            self.send_error(503)
            return
        self.send_response(200)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        if mode == "cut off":
            self.wfile.write(content[: len(content) // 2])
            self.wfile.flush()
            self.connection.shutdown(socket.SHUT_RDWR)
        elif mode == "wrong":
            self.wfile.write(b"x" * len(content))
        elif mode == "stalled":
            self.wfile.write(content[:10])
            self.wfile.flush()
            threading.Event().wait(3.0)
        else:
            self.wfile.write(content)

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def server() -> Iterator[Server]:
    with Server() as made:
        thread = threading.Thread(target=made.serve_forever, args=(0.02,), daemon=True)
        thread.start()
        made.pages = {"/data/sub%20folder/a.bin": CONTENT, "/data/b.bin": CONTENT[::-1]}
        yield made
        made.shutdown()


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    """No waiting between attempts, no proxy between us and the loopback."""
    monkeypatch.setattr("pooch.core.time.sleep", lambda _: None)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setenv("no_proxy", "127.0.0.1")


def files() -> tuple[RemoteFile, ...]:
    return (
        RemoteFile("a.bin", "sub folder/a.bin", hashlib.sha256(CONTENT).hexdigest(), len(CONTENT)),
        RemoteFile("b.bin", "b.bin", hashlib.sha256(CONTENT[::-1]).hexdigest(), len(CONTENT)),
    )


def kept(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*") if path.is_file()) if folder.exists() else []


def test_whole(server, tmp_path):
    folder = tmp_path / "cache" / "set"
    assert download(files(), server.url, folder) == folder
    assert (folder / "a.bin").read_bytes() == CONTENT
    assert kept(folder) == ["a.bin", "b.bin"]
    assert is_cached(folder, files())
    check_folder(folder, files())
    count = len(server.requests)
    download(files(), server.url + "/", folder)
    assert len(server.requests) == count == 2, "what is there whole is not fetched again"


@pytest.mark.parametrize(
    ("mode", "words"),
    [
        ("wrong", ["another SHA-256", "another network"]),
        ("cut off", ["cut off", "try again"]),
        ("error", ["the answer 503", "try again later"]),
        ("stalled", ["no answer in time"]),
    ],
)
def test_each_failure_is_told_retried_and_leaves_nothing(server, tmp_path, mode, words):
    server.mode = mode
    with pytest.raises(DownloadError) as caught:
        download(files(), server.url, tmp_path / "set", retries=1, timeout_s=0.5)
    told = str(caught.value)
    for word in [
        "a.bin: got",
        f"from {server.url}/sub%20folder/a.bin",
        "SHA-256",
        "MJX_CUTTING_DATA",
        *words,
    ]:
        assert word in told
    assert kept(tmp_path) == []
    assert len(server.requests) == 2, "one attempt and one retry"


@pytest.mark.parametrize("mode", ["wrong", "cut off", "error"])
def test_a_passing_failure_is_overcome(server, tmp_path, mode):
    server.mode, server.fail_first = mode, 1
    download(files(), server.url, tmp_path / "set", retries=2)
    assert kept(tmp_path) == ["a.bin", "b.bin"]
    assert len(server.requests) == 3


def test_no_such_file_on_the_server(server, tmp_path):
    del server.pages["/data/b.bin"]
    with pytest.raises(DownloadError, match=r"b\.bin: got the answer 404"):
        download(files(), server.url, tmp_path / "set", retries=0)
    assert kept(tmp_path) == ["a.bin"], "a file that came whole is kept for the next attempt"
    assert (tmp_path / "set" / "a.bin").read_bytes() == CONTENT


def test_no_network(tmp_path):
    with contextlib.closing(socket.socket()) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with pytest.raises(DownloadError) as caught:
        download(files(), f"http://127.0.0.1:{port}", tmp_path / "set", retries=1)
    assert "no connection" in str(caught.value) and "check the network" in str(caught.value)
    assert isinstance(caught.value, OSError)
    assert kept(tmp_path) == []


def test_a_spoilt_cache_is_mended(server, tmp_path):
    folder = tmp_path / "set"
    download(files(), server.url, folder)
    (folder / "a.bin").write_bytes(CONTENT[:100])
    assert not is_cached(folder, files())
    download(files(), server.url, folder)
    assert (folder / "a.bin").read_bytes() == CONTENT
    assert len(server.requests) == 3


def test_a_failed_mend_keeps_the_old_file(server, tmp_path):
    folder = tmp_path / "set"
    download(files(), server.url, folder)
    (folder / "a.bin").write_bytes(b"spoilt")
    server.mode = "cut off"
    with pytest.raises(DownloadError, match="cut off"):
        download(files(), server.url, folder, retries=0)
    assert kept(folder) == ["a.bin", "b.bin"] and (folder / "a.bin").read_bytes() == b"spoilt"


def test_a_cache_that_cannot_be_written(server, tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(DownloadError, match="cache that cannot be written"):
        download(files(), server.url, tmp_path / "file" / "set", retries=0)


def test_a_local_copy_is_checked(tmp_path):
    with pytest.raises(ValueError, match=r"a\.bin: got no such file"):
        check_folder(tmp_path, files())
    (tmp_path / "a.bin").write_bytes(CONTENT)
    (tmp_path / "b.bin").write_bytes(CONTENT)
    with pytest.raises(ValueError, match=r"b\.bin: got SHA-256 .* expected .* replace it"):
        check_folder(tmp_path, files())


def test_the_bar_counts_bytes(tmp_path):
    from rich.progress import Progress

    from mjx_cutting.trials.download import _Bar

    progress = Progress(disable=True)
    bar = _Bar(progress, files()[0])
    bar.update(1000)
    assert progress.tasks[0].completed == 1000
    bar.reset()
    bar.update(len(CONTENT))
    bar.close()
    assert progress.tasks[0].completed == progress.tasks[0].total == len(CONTENT)
