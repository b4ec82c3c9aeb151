"""The C header: compiles without a warning, allocates nothing, equals JAX and the NumPy runtime."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
import pytest

from mjx_cutting.deploy import export
from mjx_cutting.deploy.artefact import ACTIVATIONS, Artefact
from mjx_cutting.deploy.c_header import write_c_header
from mjx_cutting.deploy.runtime import TOLERANCE, PolicyRuntime
from mjx_cutting.learning.policy import Policy

WARNINGS = ("-Wall", "-Wextra", "-Werror", "-pedantic")

# Reads observations; writes for each the status, the action, and the set-point one period on.
PROGRAM = """
#include <stdio.h>
#include "policy.h"
int main(void)
{
    float observation[MJX_CUTTING_POLICY_OBSERVATIONS], action[MJX_CUTTING_POLICY_ACTIONS] = {0};
    double set_point[MJX_CUTTING_POLICY_ACTIONS] = {START};
    if (mjx_cutting_policy_verify() > 5e-5) return 3;
    while (fread(observation, sizeof observation, 1, stdin) == 1) {
        int status = mjx_cutting_policy_action(observation, action);
        mjx_cutting_policy_advance(set_point, action);
        fwrite(&status, sizeof status, 1, stdout);
        fwrite(action, sizeof action, 1, stdout);
        fwrite(set_point, sizeof set_point, 1, stdout);
    }
    return 0;
}
"""
RECORD = np.dtype([("status", np.int32), ("action", np.float32, 5), ("set_point", np.float64, 5)])


def compiled(artefact: Artefact, folder: Path, compiler: str = "gcc", *flags: str) -> Path:
    write_c_header(artefact, folder / "policy.h")
    start = ", ".join(map(repr, artefact.action_initial))
    suffix = ".cpp" if compiler == "g++" else ".c"
    (folder / f"main{suffix}").write_text(PROGRAM.replace("START", start))
    command = [compiler, *flags, *WARNINGS, f"main{suffix}", "-o", "main", "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return folder / "main"


def served(program: Path, observations: np.ndarray) -> np.ndarray:
    done = subprocess.run(
        [program], input=observations.astype(np.float32).tobytes(), capture_output=True, timeout=60
    )
    assert done.returncode == 0, done.returncode
    return np.frombuffer(done.stdout, RECORD)


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_equals_jax_on_ten_thousand_observations(
    activation: str, make_policy: Callable[..., Policy], tmp_path: Path
) -> None:
    policy = make_policy(activation, (32, 64))
    artefact = export.build(policy)
    scaled = export.golden_observations(artefact.mean, artefact.std, artefact.clip, pairs=10_000, seed=7)
    physical = scaled * np.asarray(artefact.observation_scales, np.float32)
    got = served(compiled(artefact, tmp_path, "gcc", "-std=c99", "-O2"), physical)
    trained = np.asarray(jax.jit(policy.apply)(scaled))
    assert not got["status"].any()
    assert np.max(np.abs(got["action"] - trained)) / 2.0 < TOLERANCE
    runtime, set_point = PolicyRuntime(artefact), np.asarray(artefact.action_initial)
    for action, moved in zip(got["action"][:300], got["set_point"][:300], strict=True):
        set_point = runtime.advance(set_point, action)
        np.testing.assert_allclose(moved, set_point, rtol=1e-9, atol=1e-12)


def test_task_sized_network(policy: Policy, tmp_path: Path) -> None:
    artefact = export.build(policy)
    got = served(compiled(artefact, tmp_path, "gcc", "-std=c99", "-O1"), artefact.golden_observation)
    assert np.max(np.abs(got["action"] - artefact.golden_action)) / 2.0 < TOLERANCE


def test_value_that_is_not_finite_changes_nothing(make_policy: Callable[..., Policy], tmp_path: Path) -> None:
    artefact = export.build(make_policy("tanh", (8,)))
    observations = np.tile(artefact.golden_observation[0], (3, 1))
    observations[1, 4] = np.nan
    got = served(compiled(artefact, tmp_path, "gcc", "-std=c99"), observations)
    assert got["status"].tolist() == [0, 1, 0]
    np.testing.assert_array_equal(got["action"][0], got["action"][1])


def test_compiles_as_cpp(make_policy: Callable[..., Policy], tmp_path: Path) -> None:
    if shutil.which("g++") is None:
        pytest.skip("there is no g++ here; the header is compiled as C all the same")
    artefact = export.build(make_policy("elu", (8,)))
    got = served(compiled(artefact, tmp_path, "g++", "-std=c++11"), artefact.golden_observation)
    assert np.max(np.abs(got["action"] - artefact.golden_action)) / 2.0 < TOLERANCE


def test_depends_on_nothing_but_math(policy: Policy, tmp_path: Path) -> None:
    text = write_c_header(export.build(policy), tmp_path / "policy.h").read_text()
    assert re.findall(r"#include (\S+)", text) == ["<math.h>"]
    assert not re.search(r"\b(malloc|calloc|free|new)\b *\(", text)
    assert not re.search(r"@\w+@", text)


def test_two_policies_in_one_program(make_policy: Callable[..., Policy], tmp_path: Path) -> None:
    for seed, prefix in enumerate(("rough", "fine")):
        policy = make_policy("tanh", (8,), seed)
        write_c_header(export.build(policy), tmp_path / f"{prefix}.h", prefix=prefix)
    program = '#include "rough.h"\n#include "fine.h"\n'
    program += "int main(void) { return rough_verify() + fine_verify() > 1e-4; }"
    (tmp_path / "main.c").write_text(program)
    command = ["gcc", "-std=c99", *WARNINGS, "main.c", "-o", "main", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=120)
    assert subprocess.run([tmp_path / "main"], timeout=60).returncode == 0


@pytest.mark.parametrize("prefix", ["", "9a", "A", "a-b", "a b"])
def test_prefix_must_be_an_identifier(prefix: str, policy: Policy, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="expected a C identifier in lower case"):
        write_c_header(export.build(policy), tmp_path / "policy.h", prefix=prefix)
    assert list(tmp_path.iterdir()) == []
