"""Imports run one way, rooms stay light, files stay short: docs/architecture.md says why."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "mjx_cutting"
LINES_AT_MOST = 400

_SIMULATION = {"cutting", "disturbance", "sim"}
_LEARNT = {*_SIMULATION, "learning", "evaluation"}
_TRACED = {"cutting", "trials"}
_ROOMS_OF_TRACING = ("records", "fitting", "guards", "naming", "along", "telling")
"""Each imports only those before it; `trace` and what stands beside it, all of them; the report, `trace`."""
_TRACING = {"tracing", *(f"tracing.{room}" for room in (*_ROOMS_OF_TRACING, "report"))}
_DEPLOY = {"deploy", "deploy.protocol", "deploy.virtual_cell", "deploy.export"}

# What each room may import of ours, besides itself and the base. A new room needs a line here.
MAY_IMPORT: dict[str, set[str]] = {
    "base": set(),
    "cutting": set(),
    "trials": {"cutting"},
    **{
        f"tracing.{room}": {*_TRACED, *(f"tracing.{each}" for each in _ROOMS_OF_TRACING[:index])}
        for index, room in enumerate(_ROOMS_OF_TRACING)
    },
    "tracing": {*_TRACED, *_TRACING},
    "tracing.report": {*_TRACED, *_TRACING},
    "disturbance": set(),
    "sim": {"cutting", "disturbance"},
    "learning": _SIMULATION,
    "evaluation": {*_SIMULATION, "learning"},
    "deploy.export": {*_LEARNT, "deploy", "deploy.protocol", "deploy.virtual_cell"},
    "deploy.protocol": set(),
    "deploy.virtual_cell": {"deploy.protocol"},
    "deploy": {"trials", "deploy.protocol"},
    "loop": {*_LEARNT, "trials", *_TRACING, *_DEPLOY},
    "cli": {*_LEARNT, "trials", *_TRACING, *_DEPLOY, "loop"},
    "front": {"cli"},
}
BASE = {"_platform", "_files", "_report", "runs"}
# Packages that no file of a room imports, not even inside a function.
FORBIDDEN = {
    "base": {"mujoco", "brax"},
    "cutting": {"mujoco", "brax"},
    "trials": {"mujoco", "brax"},
    **{room: {"mujoco", "brax"} for room in _TRACING},
    "disturbance": {"mujoco", "brax"},
    "deploy.protocol": {"jax", "numpy", "mujoco"},
    "deploy.virtual_cell": {"jax", "jaxlib", "flax", "equinox", "brax"},
    "deploy": {
        "jax",
        "jaxlib",
        "flax",
        "equinox",
        "optax",
        "orbax",
        "brax",
        "mujoco",
        "tinygp",
        "optimistix",
    },
}
# What importing a module must leave unloaded, transitively.
UNLOADED = {
    "mjx_cutting": {"jax", "numpy", "mujoco", "brax", "matplotlib"},
    "mjx_cutting.cli": {"jax", "mujoco", "brax", "matplotlib", "scipy"},
    "mjx_cutting.trials.dataset": {"jax", "mujoco", "brax", "matplotlib"},
    "mjx_cutting.deploy.runtime": {
        "jax",
        "jaxlib",
        "mujoco",
        "brax",
        "scipy",
        "matplotlib",
        "flax",
        "equinox",
    },
    "mjx_cutting.deploy.artefact": {"jax", "jaxlib", "mujoco", "brax", "scipy", "matplotlib", "flax"},
    **{
        f"mjx_cutting.deploy.{name}": {"jax", "jaxlib", "mujoco", "brax", "scipy", "matplotlib", "flax"}
        for name in ("protocol", "safety", "server", "service", "recorder", "client", "stats", "sessions")
    },
    "mjx_cutting.trials.parts": {"jax", "mujoco", "brax", "matplotlib"},
    "mjx_cutting.cutting": {"mujoco", "brax", "matplotlib"},
    "mjx_cutting.tracing": {"mujoco", "brax"},
    "mjx_cutting.disturbance": {"mujoco", "brax", "matplotlib"},
}


def room_of(module: str) -> str | None:
    """The room of a dotted module name of ours; None for any other package."""
    parts = module.split(".")
    if parts[0] != "mjx_cutting":
        return None
    if len(parts) == 1:
        return "base"
    if parts[1] in BASE:
        return "base"
    if parts[1] == "__main__":
        return "front"
    if parts[1] == "deploy":
        third = parts[2] if len(parts) > 2 else ""
        if third.startswith("export"):
            return "deploy.export"
        return f"deploy.{third}" if third in ("protocol", "virtual_cell") else "deploy"
    if ".".join(parts[1:3]) in _TRACING:
        return ".".join(parts[1:3])
    return parts[1]


def module_name(path: Path, root: Path = ROOT) -> str:
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(source: str, module: str, is_package: bool) -> Iterator[tuple[int, str]]:
    """Line and dotted name of every import, wherever in the file it stands."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parents = module.split(".") if is_package else module.split(".")[:-1]
                parents = parents[: len(parents) - node.level + 1]
                base = ".".join([*parents, *([node.module] if node.module else [])])
            for alias in node.names:
                yield node.lineno, f"{base}.{alias.name}"


def breaches(source: str, module: str, is_package: bool = False) -> list[str]:
    """What a file of ours imports against the direction, one line each."""
    room = room_of(module)
    if module == "mjx_cutting":
        return []  # the facade, whose names load on first use; UNLOADED checks it
    if room not in MAY_IMPORT:
        return [f"{module}: the room {room!r} has no line in MAY_IMPORT"]
    found = []
    for line, name in imports(source, module, is_package):
        top = name.split(".")[0]
        if top in {"experiments", "benchmarks", "tests"}:
            found.append(f"{module}:{line} imports {name}: nothing in the package does")
        if top in FORBIDDEN.get(room, set()):
            found.append(f"{module}:{line} imports {top}, which {room} must not")
        other = room_of(name)
        if other is None or other in {"base", room} or other in MAY_IMPORT[room]:
            continue
        found.append(f"{module}:{line} imports {name}: {room} must not import {other}")
    return found


def package_files() -> list[Path]:
    return sorted(path for path in PACKAGE.rglob("*.py") if "__pycache__" not in path.parts)


def test_imports_run_one_way() -> None:
    found = []
    for path in package_files():
        found += breaches(path.read_text(), module_name(path), path.name == "__init__.py")
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("module", "source", "told"),
    [
        (
            "mjx_cutting.cutting.force",
            "def f():\n    from mjx_cutting.sim import env",
            "cutting must not import sim",
        ),
        ("mjx_cutting.cutting.force", "from ..tracing import verdict", "cutting must not import tracing"),
        ("mjx_cutting.disturbance.fit", "import mujoco.mjx", "disturbance must not"),
        ("mjx_cutting.deploy.runtime", "import jax.numpy as jnp", "imports jax"),
        (
            "mjx_cutting.deploy.server",
            "from mjx_cutting.deploy import export",
            "deploy must not import deploy.export",
        ),
        ("mjx_cutting.deploy.virtual_cell.saw", "from mjx_cutting.cutting import model", "must not"),
        ("mjx_cutting.deploy.virtual_cell.saw", "from mjx_cutting.deploy import safety", "must not"),
        ("mjx_cutting.deploy.protocol", "from mjx_cutting.deploy import safety", "must not"),
        ("mjx_cutting.learning.bc", "from experiments import adapt", "nothing in the package does"),
        ("mjx_cutting.tracing.records.lines", "from mjx_cutting.tracing.fitting import fit", "must not"),
        ("mjx_cutting.tracing.guards.smeared", "from mjx_cutting.tracing import trace", "must not"),
        ("mjx_cutting.newroom.file", "import numpy", "no line in MAY_IMPORT"),
    ],
)
def test_a_breach_is_found(module: str, source: str, told: str) -> None:
    assert any(told in line for line in breaches(source, module))


@pytest.mark.parametrize(
    ("module", "source"),
    [
        (
            "mjx_cutting.tracing.naming.search",
            "from ...cutting import ForceModel\nfrom ..fitting import fit\nimport optimistix",
        ),
        ("mjx_cutting.deploy.export", "from mjx_cutting.learning.policy import Policy\nimport jax"),
        (
            "mjx_cutting.deploy.virtual_cell.cell",
            "from mjx_cutting.deploy.protocol import State\nimport mujoco",
        ),
        ("mjx_cutting.sim.env", "from mjx_cutting import _platform\nimport mujoco"),
    ],
)
def test_a_downhill_import_passes(module: str, source: str) -> None:
    assert breaches(source, module) == []


@pytest.mark.parametrize("module", sorted(UNLOADED))
def test_importing_leaves_unloaded(module: str) -> None:
    code = f"import sys, json, {module}; print(json.dumps(sorted({{n.split('.')[0] for n in sys.modules}})))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    loaded = set(json.loads(done.stdout.splitlines()[-1])) & UNLOADED[module]
    assert not loaded, f"import {module} loads {sorted(loaded)}"


def test_files_stay_short() -> None:
    folders = [PACKAGE, ROOT / "tests", ROOT / "experiments", ROOT / "benchmarks"]
    long = {
        str(path.relative_to(ROOT)): lines
        for folder in folders
        for path in folder.rglob("*.py")
        if (lines := len(path.read_text().splitlines())) > LINES_AT_MOST
    }
    assert not long, f"more than {LINES_AT_MOST} lines, so two ideas: {long}"


def test_no_drawer_for_everything() -> None:
    drawers = [
        str(p.relative_to(ROOT)) for p in package_files() if p.stem in {"utils", "helpers", "misc", "common"}
    ]
    assert not drawers
