"""From a trained policy to the hardware: the exported file, and the runtime that needs NumPy alone.

Writing one from a trained policy takes JAX and stands apart in `mjx_cutting.deploy.export`.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mjx_cutting.deploy.artefact import Artefact
    from mjx_cutting.deploy.runtime import PolicyRuntime, verify

_HOMES = {"Artefact": "artefact", "PolicyRuntime": "runtime", "verify": "runtime"}

__all__ = ["Artefact", "PolicyRuntime", "verify"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
