"""What is served moves its set-points as the simulation did in training."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from mjx_cutting.deploy.export import build
from mjx_cutting.deploy.runtime import PolicyRuntime
from mjx_cutting.learning.policy import Policy
from mjx_cutting.sim import EnvConfig, action


def test_set_points_follow_as_in_the_environment(make_policy: Callable[..., Policy]) -> None:
    config = EnvConfig()
    bounds = action.limits(config)
    policy = make_policy("tanh", (8,))
    log_start = np.asarray(action.log_start(config))
    start = np.where(bounds.log, np.exp(log_start), log_start)
    start = np.clip(start, bounds.low, bounds.high)
    description = dataclasses.replace(
        policy.description,
        action_names=bounds.names,
        action_units=bounds.units,
        action_low=bounds.low,
        action_high=bounds.high,
        action_rate_per_s=bounds.rate,
        action_log=bounds.log,
        action_initial=tuple(start.tolist()),
        policy_period_s=config.policy_step_s,
    )
    runtime = PolicyRuntime(build(dataclasses.replace(policy, description=description), pairs=1))
    follow = jax.jit(lambda s, a: action.follow(s, a, bounds, config.policy_step_s))
    draw = np.random.default_rng(0)
    served, simulated = start, jnp.asarray(log_start, jnp.float32)
    span = np.asarray(bounds.high) - np.asarray(bounds.low)
    for _ in range(30):
        wish = draw.uniform(-1.2, 1.2, 5).astype(np.float32)
        for _ in range(draw.integers(1, 30)):
            served = runtime.advance(served, wish)
            simulated = follow(simulated, wish)
        inner = np.asarray(simulated, np.float64)
        expected = np.where(bounds.log, np.exp(np.where(bounds.log, inner, 0.0)), inner)
        assert np.max(np.abs(served - expected) / span) < 5e-5
