"""Settings and seeds side by side equal each alone."""

import dataclasses

import jax
import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.learning import sweep
from mjx_cutting.learning.ppo import PPO
from mjx_cutting.learning.settings import PPOConfig

CONFIG = PPOConfig(
    steps=3 * 256,
    envs=16,
    unroll_length=16,
    minibatches=2,
    epochs=1,
    reward_scaling=1.0,
    hidden=(8,),
    value_hidden=(8,),
)


@pytest.mark.slow
def test_side_by_side_equals_alone(point_env, batched):
    proposals = [{"learning_rate": 1e-3, "discount": 0.9}, {"learning_rate": 1e-2, "discount": 0.99}]
    found = sweep.train_all(point_env(), CONFIG, proposals, seeds=2, seed=5)
    assert found.shape == (2, 2)
    ppo = PPO(batched(point_env()), dataclasses.replace(CONFIG, **proposals[1]))
    state = jax.jit(ppo.initialise)(jax.random.PRNGKey(6))
    iterate = _platform.jit(ppo.iterate)
    for _ in range(3):
        state, told = iterate(state)
    # the last tenth of three iterations is one
    assert found[1, 1] == pytest.approx(float(told["episode_return"]), abs=1e-3)
    assert len(np.unique(found)) == 4


@pytest.mark.slow
def test_training_that_is_not_finite_has_no_reward(point_env):
    found = sweep.train_all(point_env(break_at=3), dataclasses.replace(CONFIG, steps=256), [{"clip": 0.2}])
    assert np.isnan(found).all()


@pytest.mark.parametrize(
    ("proposals", "told"),
    [
        ([{"envs": 8}], "got a proposal of envs"),
        ([{"clip": 0.1}, {"discount": 0.9}], "the same settings in each"),
        ([{"clip": 2.0}], "got clip=2.0"),
    ],
)
def test_proposals_that_cannot_be_are_refused(point_env, proposals, told):
    with pytest.raises(ValueError, match=told):
        sweep.train_all(point_env(), CONFIG, proposals)
