"""The ONNX form: checked, self-describing, equal to JAX."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
import onnx
import onnxruntime
import pytest

from mjx_cutting.deploy import export
from mjx_cutting.deploy.artefact import ACTIVATIONS
from mjx_cutting.deploy.onnx_model import verify_onnx, write_onnx
from mjx_cutting.deploy.runtime import TOLERANCE, PolicyRuntime
from mjx_cutting.learning.policy import Policy


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_equals_jax_on_ten_thousand_observations(
    activation: str, make_policy: Callable[..., Policy], tmp_path: Path
) -> None:
    policy = make_policy(activation)
    artefact = export.build(policy)
    session = onnxruntime.InferenceSession(str(write_onnx(artefact, tmp_path / "policy.onnx")))
    scaled = export.golden_observations(artefact.mean, artefact.std, artefact.clip, pairs=10_000, seed=7)
    physical = scaled * np.asarray(artefact.observation_scales, np.float32)
    action, set_point = session.run(["action", "set_point"], {"observation": physical})
    trained = np.asarray(jax.jit(policy.apply)(scaled))
    assert np.max(np.abs(action - trained)) / 2.0 < TOLERANCE
    runtime = PolicyRuntime(artefact)
    expected = np.stack([runtime.set_point(a) for a in action])
    span = np.asarray(artefact.action_high) - np.asarray(artefact.action_low)
    assert np.max(np.abs(set_point - expected) / span) < 1e-5


def test_says_what_it_is(policy: Policy, tmp_path: Path) -> None:
    artefact = export.build(policy, pairs=4)
    model = onnx.load(write_onnx(artefact, tmp_path / "policy.onnx"))
    assert model.opset_import[0].version == 17
    told = {entry.key: entry.value for entry in model.metadata_props}
    header = json.loads(told["header"])
    assert header["sha256"] == artefact.sha256
    assert header["action_names"] == list(artefact.action_names)
    assert header["action_rate_per_s"][4] is None  # unlimited: JSON has no infinity
    assert "s^-2" in header["conventions"]["gains"]


def test_golden_pairs_are_replayed(policy: Policy, tmp_path: Path) -> None:
    artefact = export.build(policy, pairs=4)
    result = verify_onnx(write_onnx(artefact, tmp_path / "policy.onnx"))
    assert result.passed and result.pairs == len(artefact.golden_action)
    model = onnx.load(tmp_path / "policy.onnx")
    bias = next(one for one in model.graph.initializer if one.name == "bias_0")
    bias.CopyFrom(onnx.numpy_helper.from_array(onnx.numpy_helper.to_array(bias) + np.float32(0.1), "bias_0"))
    onnx.save(model, tmp_path / "changed.onnx")
    assert not verify_onnx(tmp_path / "changed.onnx").passed


@pytest.mark.parametrize("content", [b"", b"no model", bytes(1000)])
def test_foreign_file(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "policy.onnx").write_bytes(content)
    with pytest.raises(ValueError, match="no exported ONNX policy"):
        verify_onnx(tmp_path / "policy.onnx")


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="got no file"):
        verify_onnx(tmp_path / "policy.onnx")


def test_missing_package(policy: Policy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(ValueError, match=r"pip install 'mjx-cutting\[export\]'"):
        write_onnx(export.build(policy, pairs=1), tmp_path / "policy.onnx")
    assert list(tmp_path.iterdir()) == []
