"""An exported policy as one C99 header: no allocation, no dependency but math.h; for FRI or ros2_control.

The header holds four functions, named after the prefix that is asked for (default mjx_cutting_policy):

    int    PREFIX_action(const float observation[O], float action[A])    0, or 1 if a value is not finite
    void   PREFIX_set_point(const float action[A], double set_point[A])          in the actions' units
    void   PREFIX_advance(double set_point[A], const float action[A])     one policy period, rate limited
    double PREFIX_verify(void)                worst golden difference, as a fraction of an action's range

and their sizes, names and units as macros. The equation is that of artefact.py. It compiles as C99 and as
C++11. It breaks under -ffast-math, where a value that is not finite is no longer seen.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable
from importlib import resources
from pathlib import Path

from mjx_cutting._files import write_atomic
from mjx_cutting.deploy.artefact import Artefact

# isort: split
import numpy as np

_ACTIVATION = {
    "tanh": "tanhf(x)",
    "relu": "(x > 0.0f ? x : 0.0f)",
    "swish": "(0.5f * x * (1.0f + tanhf(0.5f * x)))",
    "elu": "(x > 0.0f ? x : expm1f(x))",
}


def write_c_header(
    artefact: Artefact, path: str | os.PathLike[str], prefix: str = "mjx_cutting_policy"
) -> Path:
    """Returns `path`, written atomically: the artefact as a C header.

    Args:
        artefact: the exported policy.
        path: the .h file to write.
        prefix: what all names in it start with, a C identifier in lower case.

    Raises:
        ValueError: the prefix is no lower-case C identifier.
        OSError: the file cannot be written.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", prefix):
        raise ValueError(f"got prefix {prefix!r}; expected a C identifier in lower case, such as my_policy")
    template = resources.files("mjx_cutting.deploy").joinpath("policy.h.template").read_text()
    values = _values(artefact, prefix)
    text = re.sub(r"@(\w+)@", lambda found: values[found[1]], template)
    return write_atomic(path, text)


def _values(artefact: Artefact, prefix: str) -> dict[str, str]:
    low, high = np.asarray(artefact.action_low), np.asarray(artefact.action_high)
    log = np.asarray(artefact.action_log)
    inner_low, inner_high = (np.where(log, np.log(np.where(log, x, 1.0)), x) for x in (low, high))
    rates = np.asarray(artefact.action_rate_per_s) * artefact.policy_period_s
    return {
        "prefix": prefix,
        "PREFIX": prefix.upper(),
        "sha256": artefact.sha256,
        "conventions": _comment(artefact),
        "observations": str(artefact.observation_size),
        "actions": str(artefact.action_size),
        "pairs": str(len(artefact.golden_action)),
        "widest": str(max([artefact.observation_size, *(bias.size for _, bias in artefact.layers)])),
        "period": repr(float(artefact.policy_period_s)),
        "observation_names": _strings(artefact.observation_names),
        "observation_units": _strings(artefact.observation_units),
        "action_names": _strings(artefact.action_names),
        "action_units": _strings(artefact.action_units),
        "scale": _floats(artefact.observation_scales),
        "clip": _floats([artefact.clip]),
        "mean": _floats(artefact.mean),
        "std": _floats(artefact.std),
        "low": _doubles(low),
        "high": _doubles(high),
        "inner_low": _doubles(inner_low),
        "inner_high": _doubles(inner_high),
        "step": _doubles(np.where(np.isfinite(rates), rates, np.finfo(np.float64).max)),
        "log": ", ".join(str(int(x)) for x in log),
        "layers": _layers(artefact),
        "golden_observation": _floats(artefact.golden_observation),
        "golden_action": _floats(artefact.golden_action),
    }


def _layers(artefact: Artefact) -> str:
    lines, source = [], "x"
    for i, (weights, bias) in enumerate(artefact.layers):
        rows, columns = weights.shape
        target = "y" if source == "x" else "x"
        last = i == len(artefact.layers) - 1
        value = "tanhf(x)" if last else _ACTIVATION[artefact.activation]
        value = re.sub(r"\bx\b", f"{target}[j]", value)
        lines += [
            "    {",
            f"        static const float weights[{rows * columns}] = {{{_floats(weights)}}};",
            f"        static const float bias[{columns}] = {{{_floats(bias)}}};",
            f"        for (j = 0; j < {columns}; ++j) {target}[j] = bias[j];",
            f"        for (i = 0; i < {rows}; ++i)",
            f"            for (j = 0; j < {columns}; ++j)",
            f"                {target}[j] += {source}[i] * weights[i * {columns} + j];",
            f"        for (j = 0; j < {columns}; ++j) {target}[j] = {value};",
            "    }",
        ]
        source = target
    lines.append(f"    for (j = 0; j < {artefact.action_size}; ++j) action[j] = {source}[j];")
    return "\n".join(lines)


def _comment(artefact: Artefact) -> str:
    told = json.dumps({"conventions": dict(artefact.conventions)}, indent=1)
    return "\n".join(f" * {line}" for line in told.replace("*/", "* /").splitlines())


def _floats(values: Iterable[float]) -> str:
    return ", ".join(_literal(np.float32(x)) + "f" for x in np.ravel(np.asarray(values, np.float32)))


def _doubles(values: Iterable[float]) -> str:
    return ", ".join(_literal(np.float64(x)) for x in np.ravel(np.asarray(values, np.float64)))


def _literal(value: np.floating) -> str:
    """The shortest decimal that reads back as the same number, always with a point or an exponent."""
    text = np.format_float_scientific(value, unique=True, trim="0")
    return text.replace("e+00", "")


def _strings(values: Iterable[str]) -> str:
    return ", ".join(json.dumps(value) for value in values)
