"""What the tests of the command line share: a process to run it in, a trained policy, a disk that is full."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

Command = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def command(tmp_path: Path) -> Command:
    """Runs `mjx-cutting` with these words in an empty folder, in a process that ran `first` before; compiled
    as for a user."""
    environment = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}

    def run(*words: object, first: str = "") -> subprocess.CompletedProcess[str]:
        become = (
            "import os, sys; os.execv(sys.executable, [sys.executable, '-m', 'mjx_cutting', *sys.argv[1:]])"
        )
        line = [sys.executable, "-c", f"{first}\n{become}", *map(str, words)]
        return subprocess.run(
            line, capture_output=True, text=True, timeout=300, cwd=tmp_path, env=environment
        )

    return run


@pytest.fixture
def trained(tmp_path: Path) -> Path:
    """A run folder with the policy of a small network in it."""
    from mjx_cutting.learning.policy import FILE, Policy, PolicyDescription
    from mjx_cutting.learning.train import TrainConfig
    from mjx_cutting.runs import open_run

    draw = np.random.default_rng(0)
    layers = tuple(
        (draw.standard_normal(shape).astype(np.float32), np.zeros(shape[1], np.float32))
        for shape in [(4, 8), (8, 4)]
    )
    policy = Policy(
        np.zeros(4, np.float32),
        np.ones(4, np.float32),
        layers,
        None,
        "tanh",
        PolicyDescription.plain(4, 2, 0.02),
    )
    run = open_run(tmp_path / "run", "train", TrainConfig(), seed=0)
    policy.save(run / FILE)
    return run


@pytest.fixture
def full_disk(tmp_path: Path) -> Iterator[tuple[Path, str, str]]:
    """A folder with no room for a policy, what the process that writes there runs first, and the message.

    A real file system of 16 kB where one may be mounted; elsewhere the process may write no file beyond 8 kB.
    """
    folder = tmp_path / "full"
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=16k", "tmpfs", str(folder)], capture_output=True, check=False
    )
    if mounted.returncode == 0:
        try:
            yield folder, "", "the disk is full"
        finally:
            subprocess.run(["umount", str(folder)], check=True)
    else:
        limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (8192, 8192))"
        yield folder, limit, "a file may not grow so large"


@pytest.fixture
def unwritable(tmp_path: Path) -> Iterator[tuple[Path, str]]:
    """A folder without write permission, and what a process runs first that the permission is to bind."""
    folder = tmp_path / "closed"
    folder.mkdir(mode=0o500)

    # root: prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE)
    yield folder, "import ctypes; ctypes.CDLL(None).prctl(24, 1, 0, 0, 0)" if os.geteuid() == 0 else ""
    folder.chmod(0o700)
