"""Measured trials: the dataset format, its checks, importers and public data. Light to import."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mjx_cutting.trials.catalogue import resolve
    from mjx_cutting.trials.dataset import AntiAlias, Dataset, LeftOut, Sensor, ToolInfo, Trial
    from mjx_cutting.trials.reading import read
    from mjx_cutting.trials.writing import write

_HOMES = {
    "AntiAlias": "dataset",
    "Dataset": "dataset",
    "LeftOut": "dataset",
    "Sensor": "dataset",
    "ToolInfo": "dataset",
    "Trial": "dataset",
    "read": "reading",
    "write": "writing",
    "resolve": "catalogue",
}

__all__ = ["AntiAlias", "Dataset", "LeftOut", "Sensor", "ToolInfo", "Trial", "read", "resolve", "write"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
