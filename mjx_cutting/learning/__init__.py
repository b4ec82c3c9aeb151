"""Policies: the expert by PPO, its adaptations by imitation or further PPO, their checkpoints.

The names are loaded on first use, so importing this room does not load brax.
"""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    "Policy": "policy",
    "PolicyDescription": "policy",
    "load_policy": "checkpoint",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
