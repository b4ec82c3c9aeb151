"""A policy with random weights, of the task's sizes and with limits of every kind."""

from __future__ import annotations

import dataclasses
import itertools
import json
from collections.abc import Callable

import numpy as np
import pytest

from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.runtime import PolicyRuntime
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


@pytest.fixture
def served() -> Artefact:
    """A policy with random weights and the task's own names, limits and rates, made without JAX."""
    return task_artefact()


def task_artefact(seed: int = 0, hidden: int = 32, period_s: float = 0.02) -> Artefact:
    draw = np.random.default_rng(seed)
    layers = tuple(
        ((draw.standard_normal((i, o)) / np.sqrt(i)).astype(np.float32), np.zeros(o, np.float32))
        for i, o in ((15, hidden), (hidden, 5))
    )
    axes = "xyz"
    artefact = Artefact(
        mean=np.zeros(15),
        std=np.ones(15),
        clip=5.0,
        layers=layers,
        activation="tanh",
        observation_names=(
            "speed_along_path",
            *(f"{name}_{axis}" for name in ("path_error", "velocity", "force") for axis in axes),
            "feed_adjustment",
            "depth",
            *(f"log_stiffness_{axis}" for axis in axes),
        ),
        observation_units=("m/s", *("m",) * 3, *("m/s",) * 3, *("N",) * 3, "1", "m", *("ln(s^-2)",) * 3),
        observation_scales=(0.0125, *(0.01,) * 3, *(0.0125,) * 3, *(10.0,) * 3, 1.0, 0.001, *(6.0,) * 3),
        action_names=("stiffness_x", "stiffness_y", "stiffness_z", "feed_adjustment", "depth"),
        action_units=("s^-2", "s^-2", "s^-2", "1", "m"),
        action_low=(50.0, 50.0, 50.0, -0.8, 0.0),
        action_high=(3000.0, 3000.0, 3000.0, 1.0, 0.002),
        action_rate_per_s=(4.1, 4.1, 4.1, 2.0, 0.002),
        action_log=(True, True, True, False, False),
        action_initial=(2450.0, 2080.0, 530.0, 0.0, 0.0),
        policy_period_s=period_s,
        golden_observation=np.zeros((1, 15)),
        golden_action=np.zeros((1, 5)),
    )
    golden = draw.standard_normal((8, 15)).astype(np.float32) * np.asarray(artefact.observation_scales)
    runtime = PolicyRuntime(artefact)
    actions = np.stack([runtime(one) for one in golden.astype(np.float32)])
    return dataclasses.replace(artefact, golden_observation=golden, golden_action=actions)


@pytest.fixture
def make_served() -> Callable[..., Artefact]:
    return task_artefact
