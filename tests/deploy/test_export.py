"""An exported policy acts as the trained one does, and an export that would not is refused."""

from __future__ import annotations

import dataclasses
import errno
import json
import os
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.deploy import artefact as artefact_file
from mjx_cutting.deploy import export
from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.runtime import TOLERANCE, PolicyRuntime, verify
from mjx_cutting.learning.networks import networks_of, normalizer_of, to_tree
from mjx_cutting.learning.policy import Policy

SCALES = np.geomspace(1e-3, 30.0, 15).astype(np.float32)
"""Those of the description in conftest.py."""


@pytest.mark.parametrize("activation", artefact_file.ACTIVATIONS)
@pytest.mark.parametrize("hidden", [(64, 64), (128, 128, 128), ()])
def test_runtime_equals_jax_on_ten_thousand_observations(
    activation: str, hidden: tuple[int, ...], make_policy: Callable[..., Policy], tmp_path: Path
) -> None:
    policy = make_policy(activation, hidden)
    exported = export.export_policy(policy, tmp_path / "policy.npz")
    scaled = export.golden_observations(exported.mean, exported.std, exported.clip, pairs=10_000, seed=5)
    low, high = exported.mean - 10 * exported.std, exported.mean + 10 * exported.std
    assert np.all(np.any(scaled == low, axis=0)) and np.all(np.any(scaled == high, axis=0))
    assert np.all(np.any(scaled < low, axis=0)) and np.all(np.any(scaled > high, axis=0))
    runtime = PolicyRuntime.load(tmp_path / "policy.npz")
    served = np.stack([runtime(o) for o in scaled * SCALES])
    trained = np.asarray(jax.jit(policy.apply)(scaled))
    assert np.max(np.abs(served - trained)) / 2.0 < TOLERANCE


def test_export_equals_the_network_it_was_trained_as(policy: Policy, tmp_path: Path) -> None:
    networks = networks_of(policy)
    export.export_policy(policy, tmp_path / "policy.npz")
    runtime = PolicyRuntime.load(tmp_path / "policy.npz")
    draw = np.random.default_rng(2)
    observations = (policy.mean + policy.std * draw.standard_normal((100, 15))).astype(np.float32)
    logits = networks.policy_network.apply(normalizer_of(policy), to_tree(policy.layers), observations)
    mode = np.asarray(networks.parametric_action_distribution.mode(logits))
    np.testing.assert_allclose(np.stack([runtime(o * SCALES) for o in observations]), mode, atol=2e-5)


def test_artefact_describes_itself(policy: Policy, tmp_path: Path) -> None:
    export.export_policy(
        policy, tmp_path / "policy.npz", provenance={"run": "runs/x"}, conventions={"force": "mean"}
    )
    read = Artefact.load(tmp_path / "policy.npz")
    d = policy.description
    for field in dataclasses.fields(d):
        assert getattr(read, field.name) == getattr(d, field.name), field.name
    assert read.conventions["force"] == "mean" and "s^-2" in read.conventions["gains"]
    assert read.provenance["strategy"] == "expert" and read.provenance["run"] == "runs/x"
    assert read.provenance["exported"]["versions"]["jax"] == jax.__version__
    with np.load(tmp_path / "policy.npz", allow_pickle=False) as file:
        header = json.loads(file["header"].tobytes())
    assert header["format"] == "mjx-cutting-policy/1" and header["sha256"] == read.sha256


def test_goldens_are_what_jax_computed(policy: Policy, tmp_path: Path) -> None:
    exported = export.export_policy(policy, tmp_path / "policy.npz", pairs=16)
    scaled = exported.golden_observation / SCALES
    expected = policy.apply(scaled)
    np.testing.assert_allclose(exported.golden_action, np.asarray(expected), atol=2e-6)
    result = verify(tmp_path / "policy.npz")
    assert result.passed and result.worst < TOLERANCE and result.pairs == len(exported.golden_action)


def test_a_runtime_that_differs_is_noticed(policy: Policy, tmp_path: Path) -> None:
    exported = export.build(policy)
    wrong = dataclasses.replace(exported, golden_action=exported.golden_action + np.float32(3e-4))
    wrong.save(tmp_path / "policy.npz")
    result = verify(tmp_path / "policy.npz")
    assert not result.passed and result.worst == pytest.approx(1.5e-4, rel=0.1)


def test_failed_verification_leaves_nothing(
    policy: Policy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Policy, "apply", lambda self, o: jnp.zeros((len(o), 5)))
    with pytest.raises(ValueError, match=r"differ from the golden ones .* nothing was written"):
        export.export_policy(policy, tmp_path / "policy.npz")
    assert list(tmp_path.iterdir()) == []


def test_full_disk_leaves_the_older_file(
    policy: Policy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "policy.npz"
    export.export_policy(policy, path)
    before = path.read_bytes()

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left") as caught:
        export.export_policy(policy, path)
    assert caught.value.filename == str(path)
    assert path.read_bytes() == before and len(list(tmp_path.iterdir())) == 1


def test_no_golden_pairs_are_refused(policy: Policy, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"got pairs=0; expected at least 1"):
        export.export_policy(policy, tmp_path / "policy.npz", pairs=0)
    assert list(tmp_path.iterdir()) == []


def test_policy_that_is_not_finite_is_refused(policy: Policy, tmp_path: Path) -> None:
    weights, bias = policy.layers[0]
    broken = dataclasses.replace(policy, layers=((weights * np.nan, bias), *policy.layers[1:]))
    with pytest.raises(ValueError, match="not finite"):
        export.export_policy(broken, tmp_path / "policy.npz")
    assert list(tmp_path.iterdir()) == []


def test_export_gives_the_same_content_twice(policy: Policy, tmp_path: Path) -> None:
    first, second = export.build(policy), export.build(policy)
    again = dataclasses.replace(second, provenance=first.provenance)
    first.save(tmp_path / "a.npz")
    again.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
