"""Shared by all tests: the measured data, one BLAS thread, a compile cache, quick tests first."""

from __future__ import annotations

import getpass
import os
import signal
import tempfile
from importlib.metadata import version
from pathlib import Path

from packaging.version import Version

# Before anything loads JAX: workers, and processes that tests start, compile each program once.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
os.environ.setdefault(
    "JAX_COMPILATION_CACHE_DIR",
    str(Path(tempfile.gettempdir()) / f"mjx-cutting-tests-xla-{getpass.getuser()}"),
)
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.5")
# Most of what tests run is compiled for one call: quickly, so. What runs for long asks for `OPTIMISED`.
# A flag that jaxlib does not know ends the process; from 0.11 on it does not know the last one.
os.environ.setdefault(
    "XLA_FLAGS",
    "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true"
    + (" --xla_cpu_use_fusion_emitters=false" if Version(version("jaxlib")) < Version("0.11") else ""),
)

import pytest

# A script's background job ignores Ctrl-C, and so would every process that tests start and interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def repository() -> Path:
    """The checkout these tests stand in."""
    return ROOT


@pytest.fixture(scope="session")
def measured_data() -> Path:
    """The folder of measured data. Set but missing fails; unset fails in CI and skips elsewhere."""
    named = os.environ.get("MJX_CUTTING_DATA")
    if named:
        folder = Path(named)
        missing = [name for name in ("slotting", "drilling") if not (folder / name).is_dir()]
        if missing:
            pytest.fail(
                f"MJX_CUTTING_DATA is {named!r}, which lacks the folders {missing}; correct it or unset it"
            )
        return folder
    if os.environ.get("CI", "").lower() in ("1", "true", "yes"):
        pytest.fail(
            "MJX_CUTTING_DATA is not set, and in CI the measured tests must run; set it to the data folder"
        )
    pytest.skip("MJX_CUTTING_DATA is not set; set it to the folder of measured data to run this test")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Puts quick tests before slow ones, and keeps a file's tests of one speed on one xdist worker."""
    items.sort(key=_is_slow)
    for item in items:
        speed = "slow" if _is_slow(item) else "quick"
        item.add_marker(pytest.mark.xdist_group(f"{item.path.relative_to(ROOT)}:{speed}"))


def _is_slow(item: pytest.Item) -> bool:
    return item.get_closest_marker("slow") is not None
