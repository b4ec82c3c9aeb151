"""What is told of many trials, the first few of it."""

from __future__ import annotations

from collections.abc import Sequence

_SHOWN = 4


def first_few(told: Sequence[str]) -> str:
    """The first four, and how many more there are."""
    more = f" and {len(told) - _SHOWN} more" if len(told) > _SHOWN else ""
    return f"{', '.join(told[:_SHOWN])}{more}"
