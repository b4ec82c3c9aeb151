"""A policy with random weights, of the task's sizes and with limits of every kind."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable

import numpy as np
import pytest

from mjx_cutting.learning.policy import Policy, PolicyDescription

DESCRIPTION = PolicyDescription(
    observation_names=tuple(f"o{i}" for i in range(15)),
    observation_units=("m/s",) * 15,
    observation_scales=tuple(np.geomspace(1e-3, 30.0, 15).tolist()),
    action_names=("gain_x", "gain_y", "gain_z", "feed_adjustment", "depth"),
    action_units=("s^-2", "s^-2", "s^-2", "1", "m"),
    action_low=(50.0, 50.0, 50.0, -0.8, 0.0),
    action_high=(3000.0, 3000.0, 3000.0, 1.0, 0.002),
    action_rate_per_s=(5.0, 5.0, 5.0, 2.0, float("inf")),
    action_log=(True, True, True, False, False),
    action_initial=(2350.0, 2040.0, 440.0, 0.0, 0.001),
    policy_period_s=0.02,
)


def random_policy(
    activation: str = "tanh", hidden: tuple[int, ...] = (128, 128, 128), seed: int = 0
) -> Policy:
    draw = np.random.default_rng(seed)
    widths = [15, *hidden, 10]
    layers = tuple(
        (
            (draw.standard_normal((i, o)) / np.sqrt(i)).astype(np.float32),
            (0.1 * draw.standard_normal(o)).astype(np.float32),
        )
        for i, o in itertools.pairwise(widths)
    )
    return Policy(
        mean=draw.standard_normal(15).astype(np.float32),
        std=draw.uniform(0.3, 2.0, 15).astype(np.float32),
        layers=layers,
        value_layers=None,
        activation=activation,
        description=DESCRIPTION,
        provenance=json.dumps({"strategy": "expert", "seed": seed}),
    )


@pytest.fixture
def make_policy() -> Callable[..., Policy]:
    return random_policy


@pytest.fixture
def policy() -> Policy:
    return random_policy()
