"""The simulation of robotic cutting: an iiwa 14 with a saw, a sheet that is cut away, the policy's view."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mjx_cutting.sim import headless

if TYPE_CHECKING:
    from mjx_cutting.sim.config import EnvConfig
    from mjx_cutting.sim.env import CuttingEnv, EnvState
    from mjx_cutting.sim.wrapper import TrainingWrapper, wrap_for_training

__all__ = ["CuttingEnv", "EnvConfig", "EnvState", "TrainingWrapper", "wrap_for_training"]

headless.choose()

_HOME = {
    "CuttingEnv": "env",
    "EnvConfig": "config",
    "EnvState": "env",
    "TrainingWrapper": "wrapper",
    "wrap_for_training": "wrapper",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
