"""mjx-cutting: name the physics a cutting force model lacks, simulate with it, adapt the policy.

The public names are loaded on first use, so `import mjx_cutting` costs nothing and a serving process that
imports `mjx_cutting.deploy.runtime` never loads JAX.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOME = {
    "Tool": "mjx_cutting.cutting",
    "Material": "mjx_cutting.cutting",
    "Cut": "mjx_cutting.cutting",
    "ForceModel": "mjx_cutting.cutting",
    "arc": "mjx_cutting.cutting",
    "Dataset": "mjx_cutting.trials",
    "Trial": "mjx_cutting.trials",
    "read": "mjx_cutting.trials",
    "resolve": "mjx_cutting.trials",
    "write": "mjx_cutting.trials",
    "DisturbanceGP": "mjx_cutting.disturbance",
    "CuttingEnv": "mjx_cutting.sim",
    "EnvConfig": "mjx_cutting.sim",
    "Policy": "mjx_cutting.learning",
    "load_policy": "mjx_cutting.learning",
    "PolicyRuntime": "mjx_cutting.deploy",
}

__all__ = [
    "__version__",
    "Cut",
    "CuttingEnv",
    "Dataset",
    "DisturbanceGP",
    "EnvConfig",
    "ForceModel",
    "Material",
    "Policy",
    "PolicyRuntime",
    "Tool",
    "Trial",
    "arc",
    "load_policy",
    "read",
    "resolve",
    "write",
]

if TYPE_CHECKING:
    from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, arc
    from mjx_cutting.deploy import PolicyRuntime
    from mjx_cutting.disturbance import DisturbanceGP
    from mjx_cutting.learning import Policy, load_policy
    from mjx_cutting.sim import CuttingEnv, EnvConfig
    from mjx_cutting.trials import Dataset, Trial, read, resolve, write


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(
            f"module {__name__!r} has no attribute {name!r}; public names: {', '.join(__all__)}"
        )
    value = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
