"""Configuration and actions: bad values are named, good ones round-trip."""

from __future__ import annotations

import dataclasses
import json

import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.sim import EnvConfig
from mjx_cutting.sim import action as actions
from mjx_cutting.sim.baseline import BaselinePolicy, baseline_action


@pytest.mark.parametrize(
    "change, message",
    [
        ({"engine": "bullet"}, "engine is 'bullet'; expected one of fused, mjx"),
        ({"disturbance_mode": "always"}, "expected one of none, observation, dynamics"),
        ({"materials": ("oak",)}, "materials is 'oak'"),
        ({"materials": ()}, "materials is empty"),
        ({"physics_rate_hz": 333.0}, "whole number of physics steps"),
        ({"physics_rate_hz": 100.0}, "physics_rate_hz is 100.0; expected 200 to 10000 Hz"),
        ({"force_average_samples": 11}, "expected 1 to 10"),
        ({"kerf_m": 1.6}, "1.6 mm is 0.0016"),
        ({"depth_m": (0.002, 0.001)}, "low < high"),
        ({"depth_m": (0.0, 0.0005)}, "baseline_depth_m"),
        ({"start_stiffness_s2": (10.0, 100.0, 100.0)}, "start_stiffness_s2"),
        ({"start_stiffness_s2": (100.0, 100.0)}, "expected 3"),
        ({"cut_m": 0.2205}, "multiple of cell_m"),
        ({"nominal_feed_m_s": float("nan")}, "nominal_feed_m_s is nan"),
        ({"failure_reward": 5.0}, "failure_reward is 5.0"),
        ({"teeth": 0}, "teeth is 0"),
    ],
)
def test_bad_values_are_named(change, message):
    with pytest.raises(ValueError, match=message.replace("(", r"\(")):
        EnvConfig(**change)


def test_it_is_frozen_and_goes_to_json():
    config = EnvConfig()
    with pytest.raises(dataclasses.FrozenInstanceError):
        config.teeth = 4
    again = json.loads(json.dumps(config.to_dict()))
    assert again["teeth"] == 20 and again["materials"][0] == "foam"
    assert config.substeps == 10 and config.max_episode_steps == 3000


def test_every_field_says_why():
    import inspect

    from mjx_cutting.sim import config as module

    source = inspect.getsource(module.EnvConfig)
    for field in dataclasses.fields(EnvConfig):
        after = source.split(f"\n    {field.name}: ", 1)[1].split("\n", 1)[1]
        assert after.strip().startswith('"""'), field.name


def test_actions_round_trip_through_their_physical_meaning():
    config = EnvConfig()
    bounds = actions.limits(config)
    physical = np.array([100.0, 700.0, 3000.0, 0.25, 0.0013])
    action = actions.to_action(physical, bounds)
    low, high = actions.internal_range(bounds)
    inner = low + 0.5 * (action + 1.0) * (high - low)
    np.testing.assert_allclose(np.concatenate([np.exp(inner[:3]), inner[3:]]), physical, rtol=1e-9)
    with pytest.raises(ValueError, match="set-points are"):
        actions.to_action([10.0, 700.0, 300.0, 0.0, 0.001], bounds)


def test_setpoints_arrive_and_clip():
    config = EnvConfig()
    bounds = actions.limits(config)
    setpoint = jnp.asarray(actions.log_start(config), jnp.float32)
    for _ in range(80):
        setpoint = actions.follow(setpoint, jnp.asarray([3.0, -3.0, 0.0, -1.0, 1.0]), bounds, 0.02)
    reached = np.asarray(setpoint)
    expected = [3000.0, 50.0, np.sqrt(50.0 * 3000.0), -0.8, 0.002]
    np.testing.assert_allclose(np.concatenate([np.exp(reached[:3]), reached[3:]]), expected, rtol=1e-4)


def test_the_baseline_asks_for_its_setpoints():
    config = EnvConfig()
    action = baseline_action(config)
    low, high = actions.internal_range(actions.limits(config))
    inner = low + 0.5 * (action + 1.0) * (high - low)
    np.testing.assert_allclose(np.exp(inner[:3]), config.start_stiffness_s2, rtol=1e-5)
    np.testing.assert_allclose(inner[3:], [0.0, 0.001], atol=1e-7)
    assert BaselinePolicy(config)(jnp.zeros((3, 15))).shape == (3, 5)
