"""The wheel holds all it needs and runs without the checkout; the README says what the checks run."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import mjx_cutting

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    run([sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(ROOT)])
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("installed")
    run(
        [
            sys.executable,
            "-m",
            "pip",
            "install",
            "-q",
            "--no-deps",
            "--no-index",
            "--target",
            str(folder),
            str(wheel),
        ]
    )
    return folder


def run(command: list[str], **kwargs: object) -> str:
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, **kwargs)  # type: ignore[call-overload]
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return str(done.stdout)


def test_wheel_holds_every_file_of_the_package(wheel: Path) -> None:
    held = {name for name in zipfile.ZipFile(wheel).namelist() if name.startswith("mjx_cutting/")}
    package = ROOT / "mjx_cutting"
    expected = {
        str(path.relative_to(ROOT))
        for path in package.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and not path.name.startswith(".")
    }
    assert held == expected
    assert "mjx_cutting/py.typed" in held
    for kind in (".xml", ".html"):
        assert any(name.endswith(kind) for name in held), f"no {kind} file in the wheel"


def test_wheel_carries_licence_and_metadata(wheel: Path) -> None:
    archive = zipfile.ZipFile(wheel)
    (metadata,) = (archive.read(n).decode() for n in archive.namelist() if n.endswith(".dist-info/METADATA"))
    assert "Requires-Dist: mujoco==3.17.0" in metadata
    assert f"Version: {mjx_cutting.__version__}" in metadata
    assert any(name.endswith("licenses/LICENSE") for name in archive.namelist())


def test_command_runs_from_the_installed_wheel(installed: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    where = run(
        [sys.executable, "-c", "import mjx_cutting; print(mjx_cutting.__file__)"],
        env=environment,
        cwd=tmp_path,
    )
    assert Path(where.strip()).is_relative_to(installed)
    help_text = run([sys.executable, "-m", "mjx_cutting", "--help"], env=environment, cwd=tmp_path)
    assert "trace" in help_text
    script = run(
        [sys.executable, str(installed / "bin" / "mjx-cutting"), "--version"], env=environment, cwd=tmp_path
    )
    assert mjx_cutting.__version__ in script


def test_simulation_finds_its_model_in_the_installed_wheel(installed: Path, tmp_path: Path) -> None:
    code = (
        "import importlib.resources as r, mujoco, mjx_cutting.sim as sim\n"
        "xml = r.files(sim).joinpath('assets', 'iiwa14.xml')\n"
        "print(xml, mujoco.MjModel.from_xml_path(str(xml)).nv)"
    )
    printed = run(
        [sys.executable, "-c", code], env={**os.environ, "PYTHONPATH": str(installed)}, cwd=tmp_path
    ).split()
    assert Path(printed[0]).is_relative_to(installed)
    assert printed[1] == "7"


def test_readme_says_the_commands_that_the_checks_run() -> None:
    script = (ROOT / ".ci" / "run").read_text()
    (install,) = re.findall(r"^INSTALL='(.*)'$", script, flags=re.MULTILINE)
    (test,) = re.findall(r"^TEST='(.*)'$", script, flags=re.MULTILINE)
    lines = [line.strip() for line in (ROOT / "README.md").read_text().splitlines()]
    assert f"{install} && {test}" in lines, f"README.md has no line that is exactly {install} && {test}"


def test_public_names_load() -> None:
    assert set(mjx_cutting.__all__) == {"__version__", *mjx_cutting._HOME}
    for name in mjx_cutting.__all__:
        assert getattr(mjx_cutting, name) is not None
    with pytest.raises(AttributeError, match=r"public names: .*ForceModel"):
        mjx_cutting.ForceModle  # noqa: B018
