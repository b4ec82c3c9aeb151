"""What is learned does not depend on the engine: the same short training on both."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mjx_cutting.learning import load_policy
from mjx_cutting.learning.train import TrainConfig, train
from mjx_cutting.sim import EnvConfig


@pytest.mark.slow
def test_short_trainings_on_both_engines_agree(tmp_path):
    policies, rewards = [], []
    for engine in ("fused", "mjx"):
        # the saw is in the sheet after a third of a second, so that all of a step counts
        env = EnvConfig(engine=engine, approach_m=0.002, cut_m=0.03, depth_rate_m_s=0.02)
        out = train(TrainConfig(out=tmp_path / engine, seed=3, preset="smoke", quiet=True, env=env))
        policies.append(load_policy(out))
        lines = (out / "metrics.jsonl").read_text().splitlines()
        rewards.append([json.loads(line)["reward"] for line in lines])
    np.testing.assert_allclose(rewards[0], rewards[1], rtol=5e-3)
    assert rewards[0] != rewards[1]  # two engines, not one twice
    for (weight, bias), (other_weight, other_bias) in zip(*(p.layers for p in policies), strict=True):
        learned = np.sqrt(np.mean(bias**2))  # biases start at zero
        assert np.sqrt(np.mean((bias - other_bias) ** 2)) < 0.05 * learned
        assert np.sqrt(np.mean((weight - other_weight) ** 2)) < 0.05 * learned
