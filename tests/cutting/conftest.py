"""Fixtures of the force path's tests."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from mjx_cutting import _platform


@pytest.fixture
def float64() -> Iterator[None]:
    """Run a test in float64."""
    with _platform.x64():
        yield
