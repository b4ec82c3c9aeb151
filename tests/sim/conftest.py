"""Shared fixtures: one environment and one compiled step serve most tests of the simulation."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.sim import CuttingEnv, EnvConfig
from mjx_cutting.sim import robot as robots

BATCH = 16


@pytest.fixture(scope="session")
def robot():
    return robots.load()


@pytest.fixture(scope="session")
def env():
    return CuttingEnv(EnvConfig())


@pytest.fixture(scope="session")
def reset(env):
    return jax.jit(jax.vmap(env.reset))


@pytest.fixture(scope="session")
def step(env):
    return jax.jit(jax.vmap(env.step))


@pytest.fixture
def state(reset):
    return reset(jax.random.split(jax.random.key(0), BATCH))


@pytest.fixture(scope="session")
def poses(robot):
    """[8, 7] joint angles and [8, 7] velocities."""
    rng = np.random.default_rng(0)
    q = rng.uniform(0.6 * robot.lower_rad, 0.6 * robot.upper_rad, (8, 7))
    return q, rng.uniform(-1.0, 1.0, (8, 7))


def scalars(values):
    """A vector as the list of scalars that the chain works on."""
    return [jnp.asarray(v) for v in values]
